"""The front door: everything that a stage does, in memory; ``import expertaug`` exports it."""
