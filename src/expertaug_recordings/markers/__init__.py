"""Positions of the markers in every frame."""
