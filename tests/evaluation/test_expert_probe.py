"""Whether F_a does the work of the expert: forecasts with the true z_e beside those with the estimated."""

from __future__ import annotations

import torch

from expertaug.evaluation.expert_probe import ExpertProbe
from expertaug.evaluation.forecasting import Drawing, forecast
from expertaug.models.hybrid import HybridModel
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.solvers.solver import Solver
from expertaug.windows import Windows

T, RK4 = torch.arange(9) * 0.1, Solver("rk4")
DRAWING = Drawing(count=0, noise=0.0, seeds=[0], t=T, begin=4, observed=4, start="y0", solver=RK4, draws_solver=RK4)


@torch.no_grad()
def probed(interaction, moved=0.0):
    """What is found of an untrained model on three windows, whose true z_e are its estimates and so much more."""
    encoder = {"kind": "recurrent", "hidden": 2, "layers": [2]}
    model = HybridModel(DampedPendulum(), encoder, interaction).build(T[:4], [0])
    windows = Windows(T, torch.randn(9, 1, 3, 2, generator=torch.Generator().manual_seed(0)))
    made = forecast(model, windows.observed(4), RK4, "y0", None)
    probe = ExpertProbe(model, DRAWING, 3)
    probe.add(made, windows, made.found.z_e[0].numpy() + moved, None, 0)
    return probe.joined(), (made.states - windows.y)[4:].square().sum(-1).mean(0)


def test_where_estimates_are_true_both_forecasts_have_the_same_error_and_else_they_differ():
    (worse, share), errors = probed({"kind": "mlp", "layers": [3]})
    torch.testing.assert_close(worse[1].float(), errors)
    torch.testing.assert_close(worse[0], worse[1])
    assert share.shape == (1,) and 0 <= share.item() <= 1
    (other, _), _ = probed({"kind": "mlp", "layers": [3]}, moved=1.0)
    assert torch.equal(other[1], worse[1]) and not torch.allclose(other[0], worse[0], rtol=1e-3)


def test_of_an_expert_alone_there_is_nothing_to_find():
    assert probed(None)[0] == (None, None)


def test_where_nobody_knows_z_e_the_share_alone_is_found():
    (worse, share), _ = probed({"kind": "mlp", "layers": [3]}, moved=float("nan"))
    assert worse is None and share is not None
