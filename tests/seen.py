"""States as the windows that models take, where a test has them as a tensor."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.windows import Windows


def seen(y: Tensor, t: Tensor | None = None, u: Tensor | None = None) -> Windows:
    """Windows of states y (T1, …, B, *state) at the first of the times t (T,), by default 0, 0.1 s, …"""
    return Windows(torch.arange(len(y)) * 0.1 if t is None else t, y, u)
