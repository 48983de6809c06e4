"""The driven pendulum: its torque, known or hidden."""

from __future__ import annotations

import math

import torch

from expertaug.systems.driven_pendulum import DrivenPendulum


def test_a_hidden_torque_moves_the_driven_pendulum_as_a_known_one_does():
    known, hidden = (DrivenPendulum(torque=torque) for torque in ("known", "hidden"))
    assert [p.name for p in hidden.interaction_parameters] == ["gamma", "A", "f"] and not hidden.inputs
    t = torch.tensor(0.3, dtype=torch.float64)
    y = torch.tensor([[0.4, -0.2], [1.0, 0.5]], dtype=torch.float64)
    z_e, z_a = y.new_tensor([[2.0], [1.5]]), y.new_tensor([[0.3, 5.0, 0.7], [0.1, 20.0, 1.1]])
    torque = z_a[:, 1:2] * torch.cos(2 * math.pi * z_a[:, 2:] * t)
    told = known.truth(t, y, z_e, z_a[:, :1], torque)
    torch.testing.assert_close(hidden.truth(t, y, z_e, z_a), told)
    torch.testing.assert_close(hidden.expert(t, y, z_e), known.expert(t, y, z_e, torch.zeros(2, 1, dtype=y.dtype)))
