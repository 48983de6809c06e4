"""Energy that a double pendulum loses: as measured along chunks of its motion, and as a model has it.

E is the mechanical energy per inertia of the first arm in s⁻² (:func:`expertaug.systems.double_pendulum.energy`), its
loss per time is in s⁻³.  An expert without friction conserves E, so along dy/dt = F_e + F_a the loss is −∇E · F_a: the
power that F_a dissipates.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from expertaug.models.decoder import Decoder
from expertaug.models.estimates import Estimates
from expertaug.systems.double_pendulum import Constants, DoublePendulum, energy, energy_gradient
from expertaug.trajectories import Trajectories


def measured_loss(chunks: Trajectories, constants: Constants) -> np.ndarray:
    """−dE/dt of measured states (N, T, 4): (N,), the median of the slopes between any two points (Theil and Sen)."""
    level = energy(chunks.y, constants)
    first, second = np.triu_indices(len(chunks.t), k=1)
    slopes = (level[:, second] - level[:, first]) / (chunks.t[second] - chunks.t[first])
    return -np.median(slopes, axis=1)


@torch.no_grad()
def dissipated_power(decoder: Decoder, states: Tensor, found: Estimates | None) -> Tensor:
    """−∇E · (F_e + F_a), the mean over given states, with the constants of the decoder's own expert.

    Arguments:
        decoder: of a double pendulum, stacked over S seeds, or without parameters.
        states: (T, S, B, 4); nothing is forecast.
        found: z_e and z_a (S, B, …) with which F_a is asked; not needed where there is no F_a.

    Returns:
        (S, B) in s⁻³.
    """
    system = decoder.system
    assert isinstance(system, DoublePendulum)
    context = None
    if decoder.interaction is not None:
        assert found is not None and found.z_e is not None
        context = decoder.interaction.context(found.z_a, found.z_e)
    z_e, time = states[0, ..., 2:], states.new_zeros(())
    total = states.new_zeros(states.shape[1:3], dtype=torch.float64)
    for y in states:
        rate = system.expert(time, y, z_e)
        if context is not None:
            rate = rate + decoder.interaction(y, context)  # type: ignore[misc]
        total -= (energy_gradient(y.double(), system.constants) * rate.double()).sum(-1)
    return total / len(states)
