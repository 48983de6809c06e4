"""The damped pendulum against its energy and its linear solution, and its choices."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from expertaug import systems
from expertaug.errors import InputError
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.settings import PendulumSettings, SimulatedSet
from expertaug.systems.simulate import sample
from simulated_pendulums import pendulum_data


def test_undamped_pendulum_keeps_its_energy():
    data = sample(DampedPendulum(), pendulum_data(alpha=(0.0, 0.0), t2_s=12.0), "train")
    theta, speed = data.y[..., 0].astype(float), data.y[..., 1].astype(float)
    total = speed**2 / 2 + data.z_e.astype(float) ** 2 * (1 - np.cos(theta))
    assert np.abs(total / total[:, :1] - 1).max() < 1e-4


def test_a_pendulum_may_start_anywhere_at_a_distance_from_rest():
    system = DampedPendulum(start_radius=[1.3, 2.3])
    y0 = system.sample_initial_state(500, torch.Generator().manual_seed(0))
    distance = y0.norm(dim=1)
    assert distance.min() >= 1.3 and distance.max() <= 2.3 and np.ptp(distance.numpy()) > 0.9
    assert (y0[:, 1].abs() > 0.5).float().mean() > 0.5
    for bad in ([1.0], [2.0, 1.0], [0.0, 9.0]):
        with pytest.raises(InputError, match="start_radius"):
            systems.load({"name": "pendulum", "start_radius": bad})


@pytest.mark.parametrize("name", ["pendulum", "driven_pendulum"])
def test_a_pendulum_of_which_the_angle_is_seen_has_its_errors_alone(name):
    y = torch.rand(4, 2, generator=torch.Generator().manual_seed(0))
    assert torch.equal(systems.load({"name": name, "observed": "angle"}).observe(y), y[:, :1])
    assert torch.equal(systems.load({"name": name}).observe(y), y)
    with pytest.raises(InputError, match=r"system\.observed"):
        systems.load({"name": name, "observed": "speed"})


def test_a_pendulum_whose_friction_is_the_experts_moves_as_the_other():
    train = SimulatedSet(size=6, z_e={"omega0": (1.5, 3.1), "alpha": (0.0, 0.6)})
    rubbed = pendulum_data().model_copy(update={"sets": {"train": train}})
    system = DampedPendulum(friction="estimated")
    assert [p.name for p in system.expert_parameters] == ["omega0", "alpha"] and not system.interaction_parameters
    assert PendulumSettings(friction="estimated").expert_names == ("omega0", "alpha")
    one = sample(system, rubbed, "train")
    y, z_e, z_a = torch.from_numpy(one.y[:, 3]), torch.from_numpy(one.z_e[:, :1]), torch.from_numpy(one.z_e[:, 1:])
    t = torch.zeros(())
    other = DampedPendulum().truth(t, y, z_e, z_a)
    torch.testing.assert_close(system.expert(t, y, torch.from_numpy(one.z_e)), other)
    with pytest.raises(InputError, match=r"system\.friction"):
        systems.load({"name": "pendulum", "friction": "known"})


def test_small_damped_oscillation_is_the_linear_solution():
    class Small(DampedPendulum):
        def sample_initial_state(self, n, generator):
            return torch.tensor([[1e-3, 0.0]], dtype=torch.float64).expand(n, 2)

    data = sample(Small(), pendulum_data(size=8), "train")
    omega0, alpha = data.z_e[:, :1].astype(float), data.z_a.astype(float)
    frequency = np.sqrt(omega0**2 - alpha**2 / 4)
    phase = frequency * data.t
    expected = 1e-3 * np.exp(-alpha * data.t / 2) * (np.cos(phase) + alpha / (2 * frequency) * np.sin(phase))
    assert (
        np.abs(data.y[..., 0] - expected).max() < 1e-6
    )  # a thousandth of the amplitude, which is what sin θ ≈ θ leaves
