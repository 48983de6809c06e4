"""Recordings cut into chunks and divided into train, validation and test."""
