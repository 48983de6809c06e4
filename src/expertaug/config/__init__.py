"""What a configuration may say, reading and checking it, and what each job takes of it."""
