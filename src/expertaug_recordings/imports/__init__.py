"""Marker files of others, from folders and archives that nobody vouches for."""
