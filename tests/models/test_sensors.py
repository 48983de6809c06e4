"""What sensors show of a state, and the state of what they show."""

from __future__ import annotations

import pytest
import torch

from expertaug.models.fit_settings import Constant, SensorConstants
from expertaug.models.sensors import Sensors
from expertaug.systems.pendulum import DampedPendulum


def test_what_is_shown_and_the_state_are_each_others_inverse():
    constants = {"theta": SensorConstants.of(offset=Constant(value=0.3, std=0.1))}
    constants["omega"] = SensorConstants.of(scale=Constant(value=2.0, std=0.1))
    sensors = Sensors.of(DampedPendulum(), constants)
    states = torch.randn(5, 1, 3, 2, dtype=torch.float64)
    shown = sensors.measured(states)
    assert torch.equal(shown[..., 0], states[..., 0] + 0.3) and torch.equal(shown[..., 1], 2 * states[..., 1])
    torch.testing.assert_close(sensors.state(shown), states)
    with_inputs = torch.cat((shown, torch.full((5, 1, 3, 1), 7.0, dtype=torch.float64)), -1)
    torch.testing.assert_close(sensors.state(with_inputs), torch.cat((states, with_inputs[..., 2:]), -1))
    ranges = sensors.state_ranges({"theta": (0.3, 1.3), "omega": (-4.0, 4.0)})
    assert ranges == {"theta": [0.0, 1.0], "omega": [-2.0, 2.0]}


def constant(value):
    return Constant(value=value, std=0.1)


@pytest.mark.parametrize(("quadratic", "cubic"), [(0.1, 0.0), (-0.1, 0.0), (0.0, 0.2), (0.0, -1 / 6), (0.2, -0.05)])
def test_a_curve_is_inverted_where_it_is_not_flat(quadratic, cubic):
    constants = {"theta": SensorConstants.of(scale=constant(2.0), offset=constant(0.3))}
    constants["theta"] = constants["theta"].model_copy(
        update={"quadratic": constant(quadratic), "cubic": constant(cubic)}
    )
    sensors = Sensors.of(DampedPendulum(), constants)
    states = torch.stack((torch.linspace(-1.2, 1.2, 41), torch.ones(41)), dim=-1).double()
    shown = sensors.measured(states)
    theta = states[:, 0]
    torch.testing.assert_close(shown[:, 0], 0.3 + 2 * (theta + quadratic * theta**2 + cubic * theta**3))
    torch.testing.assert_close(sensors.state(shown), states, atol=1e-9, rtol=0)
    low, high = sensors.curve.ends
    assert low[0] < -1.2 and high[0] > 1.2 and low[1] == -torch.inf and high[1] == torch.inf


def test_beyond_the_flat_places_of_a_curve_is_their_state():
    sensors = Sensors.of(DampedPendulum(), {"theta": SensorConstants.of(cubic=constant(-1 / 6))})
    low, high = sensors.curve.ends
    assert float(high[0]) == pytest.approx((1.8) ** 0.5) and float(low[0]) == -float(high[0])  # 1 - y²/2 = 0.1
    shown = torch.tensor([[5.0, 0.0], [-5.0, 0.0], [torch.nan, 0.0]], dtype=torch.float64)
    states = sensors.state(shown)
    assert states[:2, 0].tolist() == [float(high[0]), float(low[0])] and states[2, 0].isnan()


def test_each_seed_has_its_curve():
    curve = SensorConstants.of(quadratic=Constant(value=0.15, seeds=[0.1, 0.2], std=0.01))
    sensors = Sensors.of(DampedPendulum(), {"theta": curve})
    states = torch.rand(4, 2, 3, 2, dtype=torch.float64)
    shown = sensors.measured(states)
    for seed, quadratic in enumerate((0.1, 0.2)):
        theta = states[:, seed, :, 0]
        torch.testing.assert_close(shown[:, seed, :, 0], theta + quadratic * theta**2)
    torch.testing.assert_close(sensors.state(shown), states, atol=1e-12, rtol=0)
    assert sensors.state_ranges({"theta": (0.0, 1.15), "omega": (0.0, 1.0)})["theta"][1] == pytest.approx(1.0)
