"""What systems are made of: constants that are good wherever they are used."""

from __future__ import annotations

import pytest
import torch

from expertaug import systems
from expertaug.evaluation.metrics import log_mse
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


@pytest.mark.parametrize(("observed", "dims"), [("angle", 1), ("all", 2)])
def test_an_error_of_each_dimension_is_of_what_is_observed(observed, dims):
    system = systems.load({"name": "pendulum", "observed": observed})
    truth = torch.zeros(3, 1, 4, 2)
    errors = log_mse(system, truth + torch.tensor([0.1, 0.1]), truth)
    assert system.error_dims == dims
    assert errors["log_mse_dim"].exp().item() == pytest.approx(0.01)
    assert errors["log_mse_sum"].exp().item() == pytest.approx(0.01 * dims)
