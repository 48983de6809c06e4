"""Interaction models F_a(y; z_a), a file for each."""
