"""Where tensors live."""

from __future__ import annotations

import torch


def device_of(name: str) -> torch.device:
    """auto, cpu or cuda; on the CPU one thread, since two busy jobs of one thread beat two of two."""
    torch.set_num_threads(1)
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(name)
