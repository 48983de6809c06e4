"""A fit of F_a to other windows: it changes where it was wrong, and hardly where it was right."""

from __future__ import annotations

import pytest
import torch
from fitted_pendulum import NOISE, OBSERVED, PRIOR, T, expert_alone, pendulum
from rubbing_term import Friction, stored

from expertaug.errors import InputError
from expertaug.inference.diagnostics.validity import refit
from expertaug.inference.settings import ValiditySettings
from expertaug.models.decoder import Decoder
from expertaug.models.fit_settings import RefinementSettings
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.solvers.solver import Solver
from seen import seen

HOW = ValiditySettings(samples=20, steps=25, learning_rate=0.01)


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
