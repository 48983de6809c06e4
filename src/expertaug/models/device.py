"""Where tensors live."""

from __future__ import annotations

import torch

from expertaug.errors import InputError


def device_of(name: str) -> torch.device:
    """auto, cpu or cuda; on the CPU one thread, since two busy jobs of one thread beat two of two.

    Raises:
        InputError: cuda is asked for and torch finds none.
    """
    torch.set_num_threads(1)
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name.startswith("cuda") and not torch.cuda.is_available():
        raise InputError("device", f"'{name}', and torch finds none here", "give auto or cpu")
    return torch.device(name)
