"""Known inputs between the times at which they are known, and who has to be given them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from expertaug.errors import InputError
from expertaug.systems.bouncing_ball import BouncingBall
from expertaug.systems.driven_pendulum import DrivenPendulum
from expertaug.systems.inputs import Linear, as_observed, check_given, check_trainable
from expertaug.systems.pendulum import DampedPendulum


def test_inputs_are_straight_lines_between_their_times_and_go_on_straight():
    t = torch.tensor([0.0, 1.0, 3.0], dtype=torch.float64)
    u = torch.rand(3, 2, 1, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    signal = Linear(t, u)
    for s in (0.0, 0.25, 1.0, 2.5, 3.0):
        expected = [np.interp(s, t.numpy(), u[:, k, 0].numpy()) for k in range(2)]
        np.testing.assert_allclose(signal(torch.tensor(s, dtype=torch.float64))[:, 0].numpy(), expected)
    torch.testing.assert_close(signal(t.new_tensor(4.0)), u[2] + (u[2] - u[1]) / 2)
    each = signal(t.new_tensor([0.5, 2.0]))
    torch.testing.assert_close(each, torch.stack((signal(t.new_tensor(0.5))[0], signal(t.new_tensor(2.0))[1])))


def test_inputs_are_given_to_systems_that_have_them_and_to_no_others():
    check_given(DrivenPendulum(), torch.zeros(3, 1))
    check_given(DampedPendulum(), None)
    for system, u, message in (
        (DrivenPendulum(), None, r"u: missing; DrivenPendulum has the known inputs torque: give u \(…, 1\)"),
        (DrivenPendulum(), torch.zeros(3, 2), "u has 2 components; DrivenPendulum has 1: torque"),
        (DampedPendulum(), torch.zeros(3, 1), "u has 1 components; DampedPendulum has none"),
    ):
        with pytest.raises(InputError, match=message):
            check_given(system, u)


def test_a_loss_of_what_jumps_at_events_trains_nothing():
    check_trainable(DampedPendulum())
    check_trainable(BouncingBall(observed="height"))
    with pytest.raises(InputError, match="what BouncingBall observes jumps at its events"):
        check_trainable(BouncingBall())


def test_an_encoder_sees_inputs_in_units_of_their_scale_beside_the_state():
    seen = as_observed(DrivenPendulum())
    assert [p.name for p in seen.state] == ["theta", "omega", "torque"]
    torch.testing.assert_close(seen.features(torch.tensor([[0.1, 0.2, 30.0]])), torch.tensor([[0.1, 0.2, 1.5]]))
    alone = DampedPendulum()
    assert as_observed(alone) is alone
