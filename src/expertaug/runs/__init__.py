"""A run of the workflow: whether its classes work, what it asks for, how it goes on, and whose folder it writes."""
