"""What systems are made of: constants that are good wherever they are used."""

from __future__ import annotations

import torch

from expertaug.systems.base import constant_like


def test_a_constant_made_within_a_transform_is_good_outside():
    x = torch.ones(2)

    def scaled(x: torch.Tensor) -> torch.Tensor:
        return (constant_like(x, [1.5, 2.5], x.dtype) * x).sum()

    torch.func.jvp(scaled, (x,), (x,))
    with torch.inference_mode():
        scaled(x)
    y = torch.ones(2, requires_grad=True)
    scaled(y).backward()
    assert y.grad.tolist() == [1.5, 2.5]
    assert not torch._C._functorch.is_functorch_wrapped_tensor(constant_like(x, [1.5, 2.5], x.dtype))
