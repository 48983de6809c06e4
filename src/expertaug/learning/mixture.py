"""States whose components are independent: a product of the marginal distributions of a set of trajectories.

The size of F_a along the data's own trajectories rewards what the expert should say: in a swing that dies away angle
and speed are correlated, and the smallest F_a with a damping there has a share of the restoring force as well.  Where
the components are independent it has none.
"""

from __future__ import annotations

import torch
from torch import Tensor


def mixture(states: Tensor) -> Tensor:
    """States (T, S, N, *state) with each component taken from another window and another time: what drives all windows
    alike makes the components of one time dependent."""
    axis, (times, _, count) = 3 - states.dim(), states.shape[:3]
    window = torch.arange(count)
    mixed = []
    for k, part in enumerate(states.split(1, dim=axis)):
        moved = (torch.arange(times).unsqueeze(1) + (k + 1) * window) % times
        mixed.append(part.movedim(2, 1)[moved, (window - k) % count].movedim(1, 2))
    return torch.cat(mixed, dim=axis)
