"""The log of each run, and its mirror in an MLflow store."""
