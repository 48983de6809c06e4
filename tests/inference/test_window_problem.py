"""What a window says of its parameters: residuals in units of the noise, and the noise that is assumed."""

from __future__ import annotations

import pytest
import torch

from cards import card
from expertaug.errors import InputError
from expertaug.inference.coordinates import LatentCoordinates
from expertaug.inference.window_problem import WindowProblem, assumed_noise
from expertaug.models.decoder import Decoder
from expertaug.models.fit_settings import RefinementSettings
from expertaug.models.posterior import Estimates
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.solvers.solver import Solver

T, NOISE = torch.arange(5, dtype=torch.float64) * 0.1, 0.05


def problem(free_start=False, **settings):
    latent = LatentCoordinates.of(card({"t": [0.0], "observed": 1}), 0)
    how = RefinementSettings.of(starts=0, **settings)
    return WindowProblem(Decoder(DampedPendulum()), T, how, NOISE, free_start, None, latent, Solver("rk4"))


def test_residuals_at_the_truth_are_what_windows_lack_in_units_of_the_noise():
    generator = torch.Generator().manual_seed(0)
    y0, added = (torch.randn(*shape, 1, 3, 2, generator=generator, dtype=torch.float64) for shape in ((), (5,)))
    z_e = torch.tensor([[[1.5], [2.0], [2.5]]], dtype=torch.float64)
    added[0] = 0
    states = Decoder(DampedPendulum()).forecast(y0, z_e, z_e[..., :0], T, Solver("rk4"))
    for free, first in ((False, 1), (True, 0)):
        window = problem(free)
        x = window.coordinates(Estimates(y0, z_e, z_e[..., :0]), y0)
        assert x.shape[-1] == sum(window.sizes) == (3 if free else 1)
        found = window.residuals(x.unsqueeze(0), states - added)[0]
        assert found.shape[-1] == window.observations == 2 * (5 - first)
        torch.testing.assert_close(found, (added[first:] / NOISE).movedim(0, 2).flatten(2))


def test_outside_of_a_components_window_there_is_no_residual():
    whole, part = problem(True), problem(True, windows={"omega": (0.0, 0.2)})
    assert (whole.observations, part.observations) == (10, 8)
    with pytest.raises(InputError, match="names speed; the state is theta, omega"):
        problem(windows={"speed": (0.0, 0.2)})


def test_the_noise_is_that_of_the_settings_or_of_the_data_or_a_thousandth_of_the_largest_value():
    bound = [50.0, 20.0]  # ten times the largest value of each component
    assert assumed_noise(RefinementSettings(noise=0.3), 0.1, bound) == 0.3
    assert assumed_noise(RefinementSettings(), 0.1, bound) == 0.1
    assert assumed_noise(RefinementSettings(), 0.0, bound) == pytest.approx(0.005)
    assert assumed_noise(RefinementSettings(), [0.1, 0.0], bound) == [0.1, pytest.approx(0.002)]
