"""Gradients of a hybrid model's loss through an implicit solver."""

import pytest
import torch

import plain_parts as parts
from expertaug.models.hybrid import HybridModel
from expertaug.systems.rlc import RLC
from expertaug.systems.solvers.solver import Solver
from seen import seen

TIMES = torch.arange(6, dtype=torch.float64) * 0.2
WINDOWS = {"U": [0.0, 1.0], "I": [0.0, 1.0]}
OURS = (
    {"kind": "window", "windows": WINDOWS, "layers": [6], "latent": 2},
    {"kind": "mlp", "layers": [5], "activation": "tanh"},
)


@pytest.mark.parametrize("pair", [OURS, (parts.LinearEncoder, parts.LinearInteraction)], ids=["stacked", "plain"])
def test_they_are_those_of_finite_differences(pair):
    model = HybridModel(RLC(), *pair).build(TIMES, [0, 1]).double()
    y = torch.randn(6, 2, 3, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)

    def loss() -> torch.Tensor:
        return (model.predict(seen(y, TIMES), Solver("rodas3"))[0] - y).square().mean()

    loss().backward()
    directions = [torch.randn_like(p) for p in model.parameters()]
    slope = sum((p.grad * d).sum() for p, d in zip(model.parameters(), directions, strict=True))
    sides = []
    for step in (1e-5, -2e-5):
        with torch.no_grad():
            for p, d in zip(model.parameters(), directions, strict=True):
                p += step * d
            sides.append(loss())
    assert torch.isfinite(slope)
    torch.testing.assert_close((sides[0] - sides[1]) / 2e-5, slope, rtol=1e-5, atol=1e-8)
