"""Robust hybrid learning with expert augmentation (Wehenkel et al., TMLR 2023) as a reproducible pipeline."""

__version__ = "0.1.0"
