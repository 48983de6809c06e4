"""torch's Adam without its compiler, which it imports for a guard against it: as much time again as torch itself."""

from __future__ import annotations

from inspect import unwrap

import torch

_Adam = torch.optim.Adam
_step = unwrap(_Adam.step)


class Adam(_Adam):
    """As torch.optim.Adam, to the bit; nothing here compiles a step."""

    add_param_group = unwrap(_Adam.add_param_group)
    zero_grad = unwrap(_Adam.zero_grad)
    state_dict = unwrap(_Adam.state_dict)
    load_state_dict = unwrap(_Adam.load_state_dict)

    @torch.no_grad()
    def step(self, closure: None = None) -> None:
        """Move the parameters by their gradients."""
        _step(self, closure)
