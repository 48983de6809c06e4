"""Plain numbers beside tensors, wherever these lie."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


def beside(like: Tensor, values: Sequence[float] | Sequence[bool] | Sequence[int], dtype: torch.dtype | None) -> Tensor:
    """The values (K,) where a tensor lies, of a type; they are sent to a card without waiting for it, as
    ``Tensor.new_tensor`` would."""
    return torch.tensor(values, dtype=dtype).to(like.device, non_blocking=True)
