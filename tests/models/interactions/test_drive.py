"""An F_a that is a force of the time alone, each window's own."""

import math

import pytest
import torch

import expertaug as ea
from expertaug.errors import InputError
from expertaug.models.decoder import Decoder
from expertaug.models.interactions.drive import DriveInteraction
from expertaug.models.settings import DriveSettings
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.reaction_diffusion import ReactionDiffusion
from expertaug.systems.solvers.solver import Solver

TIMES = torch.linspace(0.0, 2.0, 21)


def test_a_window_is_driven_by_its_own_amplitudes():
    drive = DriveInteraction(DampedPendulum(), 4, TIMES, harmonics=3, lowest=2, components=["omega"], start=5.0)
    z_a, t = torch.tensor([[1.0, 0.0, 0.0, -2.0], [0.0, 0.5, 0.0, 0.0]]), torch.tensor(0.3)
    rates = drive(torch.randn(2, 2), drive.context(z_a, torch.ones(2, 1)), t.expand(2, 1))
    phase = math.pi * 0.3 / 2.0
    assert rates[:, 0].tolist() == [0.0, 0.0]
    wanted = [5 * math.sin(2 * phase) - 10 * math.cos(3 * phase), 2.5 * math.cos(2 * phase)]
    assert rates[:, 1].tolist() == pytest.approx(wanted, rel=1e-5)


def test_forecasts_follow_the_drive():
    system = DampedPendulum()
    decoder = Decoder(system, DriveInteraction(system, 2, TIMES, harmonics=1, components=["omega"]))
    z_a, y0, omega0 = torch.tensor([[3.0, 0.0]]), torch.zeros(1, 2), torch.full((1, 1), 1e-3)  # hardly a pendulum
    with torch.no_grad():
        y = decoder.forecast(y0, omega0, z_a, TIMES, Solver("rk4", substeps=4))
    rate = math.pi / 2.0
    speed = 3.0 / rate * (1 - torch.cos(rate * TIMES))
    torch.testing.assert_close(y[:, 0, 1], speed, atol=1e-4, rtol=1e-4)


def test_a_field_is_driven_as_a_whole():
    system = ReactionDiffusion()
    drive = DriveInteraction(system, 4, TIMES, harmonics=1)
    y = torch.randn(3, *system.state_shape)
    rates = drive(y, drive.context(torch.randn(3, 4), torch.ones(3, 2)), torch.full((3, 1), 0.7))
    assert rates.shape == y.shape and rates.flatten(2).std(-1).max() < 1e-5 and rates.abs().max() > 0.01


def test_stacked_seeds_agree_with_single_ones():
    system = DampedPendulum()
    y, z_a, z_e, t = torch.randn(3, 4, 2), torch.randn(3, 4, 8), torch.ones(3, 4, 1), torch.full((3, 4, 1), 0.4)
    single = [DriveInteraction(system, 8, TIMES, harmonics=2) for _ in range(3)]
    for k, one in enumerate(single):
        one.logs.data += 0.1 * k
    stacked = DriveInteraction(system, 8, TIMES, harmonics=2)
    stacked.logs = torch.nn.Parameter(torch.stack([one.logs.data for one in single]))
    rates = stacked(y, stacked.context(z_a, z_e), t)
    for k, one in enumerate(single):
        torch.testing.assert_close(rates[k], one(y[k], one.context(z_a[k], z_e[k]), t[k]))


def test_sizes_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match=r"harmonics: F_a has 6 amplitudes .* and z_a 3; give z_a \(latent\) 6"):
        ea.DriveInteraction(DampedPendulum(), 3, TIMES, harmonics=3, components=["omega"])
    with pytest.raises(InputError, match=r"lowest: found 9; give 8, the last, or less"):
        DriveSettings.of(lowest=9)
