"""Layers and networks that compute one seed or a group of seeds alike."""
