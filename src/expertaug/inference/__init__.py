"""Inference on observed windows: least squares, refinement, posteriors, and what they are worth."""
