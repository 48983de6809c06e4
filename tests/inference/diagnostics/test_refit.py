"""A fit of F_a to other windows: it changes where it was wrong, and hardly where it was right."""

from __future__ import annotations

import pytest
import torch
from test_least_squares import NOISE, OBSERVED, PRIOR, T, expert_alone, pendulum
from torch import nn

from expertaug.errors import InputError
from expertaug.evaluation import validity
from expertaug.evaluation.settings import FittedVersion, ValidityJob
from expertaug.inference.diagnostics.validity import refit
from expertaug.inference.settings import ValiditySettings
from expertaug.models.decoder import Decoder
from expertaug.models.settings import Refinement, RefinementSettings
from expertaug.models.store import StoredModel
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.solvers.solver import Solver
from seen import seen

HOW = ValiditySettings(samples=20, steps=25, learning_rate=0.01)


class Friction(nn.Module):
    """−z_a θ' − drag θ' |θ'| of two seeds, of which the training found the first part alone."""

    def __init__(self, drag: float = 0.0) -> None:
        super().__init__()
        self.drag = nn.Parameter(torch.full((2, 1, 1), drag))

    def context(self, z_a, z_e):
        return z_a

    def forward(self, y, context):
        speed = y[..., 1:]
        return torch.cat((torch.zeros_like(speed), -context * speed - self.drag * speed * speed.abs()), -1)


def stored(decoder, data):
    alone = expert_alone("pendulum", data).card
    latent = {"mean": [[0.3]] * 2, "std": [[0.17]] * 2}
    return StoredModel(decoder, alone.but(kind="alternating", latent=latent))


def made(drag, z_e, n=16):
    """Windows y (T1, 1, N, 2) of a pendulum with the drag, and their truths."""
    system = DampedPendulum()
    data = pendulum(z_e, damping=(0.2, 0.5), n=n)
    y0, true, z_a = (torch.from_numpy(value) for value in (data.y[:, 0], data.z_e, data.z_a))
    with torch.no_grad():
        one = [value.expand(2, *value.shape) for value in (y0, true, z_a)]
        y = Decoder(system, Friction(drag)).forecast(*one, torch.from_numpy(T).float(), Solver("rk4"))[:OBSERVED, 0]
    noise = NOISE * torch.randn(y.shape, generator=torch.Generator().manual_seed(1))
    return seen(y + noise).with_seeds(), (true, z_a), data


@pytest.mark.slow
def test_f_a_changes_where_it_lacks_something():
    right, truth, data = made(0.0, (1.5, 3.1))
    lacking, _, _ = made(0.3, (0.8, 1.5))
    model = stored(Decoder(DampedPendulum(), Friction()), data)
    fit = RefinementSettings(starts=16, tries=2, steps=15)
    own = refit(model, right, NOISE, PRIOR, fit, HOW, truth)
    other = refit(model, lacking, NOISE, PRIOR, fit, HOW)
    assert own.z_e.shape == (2, 16, 1) and own.chi2.shape == own.squares.shape == (2, 16) and other.wrong is None
    assert own.change().max() < 0.1 and other.change().min() > 3 * own.change().max()
    assert other.chi2_after.mean() < 0.9 * other.chi2.mean() and 0.7 < own.chi2.median() < 1.3
    assert own.wrong[0].median() < 0.1, "z_a is found from noisy windows"
    mask = torch.arange(16) < 4
    assert other.change(mask).shape == (2,)
    torch.testing.assert_close(model.model.interaction.drag, torch.zeros(2, 1, 1)), "the model stays as it is"


def test_a_model_without_f_a_has_nothing_to_fit():
    _, _, data = made(0.0, (1.5, 3.1), n=2)
    with pytest.raises(InputError, match="has no interaction model"):
        refit(expert_alone("pendulum", data), seen(torch.zeros(OBSERVED, 1, 2, 2)), NOISE, PRIOR)


@pytest.mark.slow
def test_the_study_has_a_sentence_a_version():
    sets = {}
    for name, z_e in (("train", (1.5, 3.1)), ("validation", (1.5, 3.1)), ("test", (0.6, 1.5))):
        sets[name] = pendulum(z_e, damping=(0.2, 0.5), n=12)
    model = stored(Decoder(DampedPendulum(), Friction()), pendulum((1.5, 3.1), n=3))
    fit = Refinement(settings=RefinementSettings(starts=8, tries=1, steps=10), noise=NOISE, prior=PRIOR)
    job = ValidityJob(
        experiment="pendulum",
        versions=[FittedVersion("aphynity", "APHYNITY", fit)],
        hues=[("aphynity", 0)],
        validity=ValiditySettings(samples=10, steps=2),
        device="cpu",
    )
    study = validity.validity([model], sets, job)
    table = study.numbers.set_index("set")
    assert list(table.index) == ["train", "validation", "test"] and table.loc["test", "windows"] == 10
    assert table.loc["test", "wrong"] < 30 and table.loc["test", "explained"] > 50
    text = study.markdown()
    assert "- APHYNITY: F_a learned on omega0 in [1." in text and "holds in" in text
    assert len(study.figure().axes) == 2 and "holds in" not in study.tex()
