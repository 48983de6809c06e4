"""Energy that a system loses: as measured along chunks of its motion, and as a model has it.

E is what the expert conserves (:meth:`expertaug.systems.System.energy`); of pendulums it is the mechanical energy per
inertia (of the first arm of two) in s⁻², its loss per time in s⁻³.  Along dy/dt = F_e + F_a of a conserving expert the
loss is −∇E · F_a: the power that F_a dissipates.
"""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.models.decoder import Decoder
from expertaug.models.estimates import Estimates
from expertaug.systems import System


def measured_loss(system: System, t: Tensor, states: Tensor, z_e: Tensor) -> Tensor:
    """−dE/dt of measured states: the median of the slopes between any two points (Theil and Sen).

    Arguments:
        t: times in s, (T,).
        states: (T, …, *state); NaN where nothing was measured: those points are left out.
        z_e: expert parameters (…, P) with which E is computed.

    Returns:
        (…,), NaN where fewer than two points were measured.
    """
    level = system.energy(states.double(), z_e.double())
    first, second = torch.triu_indices(len(t), len(t), offset=1)
    span = (t[second] - t[first]).view(-1, *[1] * (level.ndim - 1))
    return -((level[second] - level[first]) / span).nanmedian(0).values


def dissipated_power(decoder: Decoder, states: Tensor, found: Estimates | None) -> Tensor:
    """−∇E · (F_e + F_a), the mean over given states, with the constants of the decoder's own expert.

    Arguments:
        decoder: of a system with an energy, stacked over S seeds, or without parameters.
        states: (T, S, B, *state); nothing is forecast; NaN where nothing was measured.
        found: z_e and z_a (S, B, …) with which E, F_e and F_a are asked; not needed where there is no F_a and neither
            E nor F_e asks for z_e.

    Returns:
        (S, B) in E's unit per second.
    """
    system = decoder.system
    z_e = states.new_zeros(*states.shape[1:3], len(system.expert_parameters)) if found is None else found.z_e
    assert z_e is not None
    context = None
    if decoder.interaction is not None:
        assert found is not None
        context = decoder.interaction.context(found.z_a, z_e)
    powers = []
    for y in states:
        with torch.no_grad():
            rate = system.expert(states.new_zeros(()), y, z_e)
            if context is not None:
                rate = rate + decoder.interaction(y, context)  # type: ignore[misc]
        exact = y.double().requires_grad_()
        (gradient,) = torch.autograd.grad(system.energy(exact, z_e.double()).sum(), exact)
        powers.append(-(gradient * rate.double()).sum(-1))
    return torch.stack(powers).nanmean(0)
