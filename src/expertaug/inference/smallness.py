"""How large an F_a is, and how much of the expert it holds.

Of all F_a that explain the data the smallest is wanted (APHYNITY, Yin et al. 2021): it leaves to the expert what the
expert can do.  Along the data's own trajectories that is not so: in a swing that dies away angle and speed are
correlated, and the smallest F_a with a damping there has a share of the restoring force as well.  Here F_a is measured
where the components of the state are independent (:func:`expertaug.learning.objectives.decorrelate`).
"""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.models.decoder import Decoder
from expertaug.systems import System
from expertaug.systems.inputs import further

STEP = 1e-4  # of an expert parameter, in its scale, for a derivative in double precision
RIDGE = 1e-6


@torch.no_grad()
def expert_tangents(
    system: System, t: Tensor, states: Tensor, z_e: Tensor, scale: Tensor, u: Tensor | None = None
) -> Tensor:
    """How F_e changes with each expert parameter, per scale of it: (P, T, S, N, *state).

    Arguments:
        t: times of the states, (T,).
        states: (T, S, N, *state).
        z_e: (S, 1, P), where the derivative is taken.
        scale: of the parameters, (P,).
        u: known inputs (T, S, N, U) of a system that has some.
    """
    wide = z_e.expand(-1, states.shape[2], -1)

    def rates(z: Tensor) -> Tensor:
        return expert_rates(system, t, states, z, u)

    moves = STEP * torch.diag(scale)
    return torch.stack([(rates(wide + move) - rates(wide - move)) / (2 * STEP) for move in moves])


def expert_rates(system: System, t: Tensor, states: Tensor, z_e: Tensor, u: Tensor | None = None) -> Tensor:
    """F_e at times t (T,) and states (T, S, N, *state), with known inputs u (T, S, N, U) where there are some."""
    known = [None] * len(t) if u is None else u
    rates = [system.expert(s, y, z_e, *further(system, y, z_e, k)) for s, y, k in zip(t, states, known, strict=True)]
    return torch.stack(rates)


def interaction_at(
    decoder: Decoder, states: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, u: Tensor | None = None
) -> Tensor:
    """F_a at every state (T, S, N, *state) for each of M pairs of z_e (S, M, P) and z_a (S, M, Q):
    (M, T, S, N, *state).  The states are at times t (T,), with known inputs u (T, S, N, U) where there are some."""
    times, seeds, count = states.shape[:3]
    points = states.movedim(1, 0).flatten(1, 2)  # (S, T·N, *state)
    pairs = z_a.shape[1]
    context = decoder.interaction.context(z_a, z_e).repeat_interleave(times * count, dim=1)
    when = t.repeat_interleave(count).repeat(pairs)
    given = () if u is None else (u.movedim(1, 0).flatten(1, 2).repeat(1, pairs, 1),)
    rates = decoder.interaction_rate(points.repeat(1, pairs, *[1] * (points.dim() - 2)), context, when, *given)
    return rates.view(seeds, pairs, times, count, *states.shape[3:]).movedim(0, 2)


def squares(rates: Tensor, tangents: Tensor) -> tuple[Tensor, Tensor]:
    """Mean squares (S,) of F_a (M, T, S, N, *state) and of its projection on tangents (P, T, S, N, *state)."""
    numbers = rates[0, :, 0].numel()
    f = rates.movedim(2, 0).flatten(2)  # (S, M, T·N·state)
    g = tangents.movedim(2, 0).flatten(2)  # (S, P, …)
    gram = g @ g.transpose(1, 2)
    ridge = RIDGE * gram.diagonal(dim1=1, dim2=2).sum(-1)[:, None, None].clamp_min(1e-30)
    inner = f @ g.transpose(1, 2)  # (S, M, P)
    held = torch.linalg.solve(gram + ridge * torch.eye(gram.shape[-1]).to(gram), inner.transpose(1, 2))
    share = (held.transpose(1, 2) * inner).sum(-1).mean(-1) / numbers
    return f.square().mean((1, 2)), share
