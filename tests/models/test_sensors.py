"""What sensors show of a state, and the state of what they show."""

from __future__ import annotations

import torch

from expertaug.models.sensors import Sensors
from expertaug.models.settings import Constant, SensorConstants
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
