"""Hybrid models: decoders, encoders, posteriors, and how seeds are stacked and stored."""
