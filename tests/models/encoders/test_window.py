"""What the encoder of windows sees of them."""

from __future__ import annotations

import torch

from expertaug.models.encoders.window import ComponentView
from expertaug.systems.rlc import RLC


def test_the_order_in_which_windows_are_written_does_not_matter():
    system, times = RLC(), torch.arange(5) * 0.1
    windows = {"U": [0.0, 0.4], "I": [0.1, 0.2]}
    observed = torch.randn(5, 3, 2)
    written, turned = (
        ComponentView(system, times, dict(items)) for items in (windows.items(), reversed(windows.items()))
    )
    assert torch.equal(written(observed), turned(observed))
