"""Metrics, tables and figures of trained models, studies of them, and the published record of a run."""
