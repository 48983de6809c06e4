"""How much of F_a the expert could say: its share of the directions in which F_e changes with its own parameters.

Along the data's own trajectories that cannot be told: in a swing that dies away angle and speed are correlated, and a
damping looks like a share of the restoring force.  F_a is measured where the components of the state are independent
(:func:`decorrelate`).
"""

from __future__ import annotations

import copy

import torch
from torch import Tensor

from expertaug.models.decoder import Decoder
from expertaug.systems import System
from expertaug.systems.inputs import further

# F_a is measured at so many windows' points, each so many points from the next, for z_a of so many windows.
STATES, EVERY, LATENTS = 64, 4, 16
NUMBERS = 2**22  # rates that are compared at a time
STEP = 1e-4  # of an expert parameter, in its scale, for a derivative in double precision
RIDGE = 1e-6


@torch.no_grad()
def expert_share(
    decoder: Decoder, states: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, u: Tensor | None = None
) -> Tensor:
    """Share (S,) of F_a's size that lies in the directions ∂F_e/∂z_e: 0 where it leaves to the expert all that the
    expert can say, 1 where another z_e would do.  Each component's rate counts in units of the expert's own.

    Arguments:
        decoder: stacked, with F_e and F_a.
        states: forecasts (T, S, B, *state).
        z_e: (S, B, P), with which they were made.
        z_a: (S, B, Q).
        t: times in s, (T,).
        u: known inputs (T, S, B, U) of a system that has some.
    """
    decoder = copy.deepcopy(decoder).cpu().double().eval()
    few = max(2, min(STATES, NUMBERS // (LATENTS * states[::EVERY, :, 0].numel())))
    here, z_e, z_a, t = (x.cpu().double() for x in (states[:, :, :few], z_e[:, :few], z_a[:, :few], t))
    u = None if u is None else u[:, :, :few].cpu().double()
    unit = expert_sizes(decoder.system, here, z_e, t, u)
    size, share = squares_beside_expert(decoder, here, z_e, z_a, t, unit, u)
    return (share / size.clamp_min(1e-30)).clamp(0, 1).sqrt()


def squares_beside_expert(
    decoder: Decoder,
    states: Tensor,
    z_e: Tensor,
    z_a: Tensor,
    t: Tensor,
    unit: Tensor,
    u: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Mean squares (S,) of F_a and of its part in the directions ∂F_e/∂z_e, where the components of the state are
    independent.

    Arguments:
        states, z_e, z_a, t, u: as of :func:`expert_share`.
        unit: of each component's rate, (S, K).
    """
    times, latents = t[::EVERY], z_a[:, :LATENTS]
    mixed = decorrelate(states[::EVERY, :, :STATES].nan_to_num(0.0, 0.0, 0.0))
    u = None if u is None else u[::EVERY, :, :STATES]
    system, middle = decoder.system, z_e.mean(1, keepdim=True).double()
    scale = torch.tensor([p.scale for p in system.expert_parameters], dtype=torch.float64, device=middle.device)
    wide = None if u is None else u.double()
    tangents = expert_tangents(system, times.double(), mixed.double(), middle, scale, wide).to(mixed)
    rates = interaction_at(decoder, mixed, z_e[:, :LATENTS], latents, times, u)
    unit = unit.view(1, len(unit), 1, -1, *[1] * (mixed.dim() - 4)).to(mixed)
    return squares(rates / unit.unsqueeze(0), tangents / unit.unsqueeze(0))


@torch.no_grad()
def expert_sizes(system: System, states: Tensor, z_e: Tensor, t: Tensor, u: Tensor | None = None) -> Tensor:
    """Root mean square of the expert's rate of each component, (S, K), along states (T, S, B, *state); other arguments
    as of :func:`expert_share`."""
    every = None if u is None else u[::EVERY]
    rate = expert_rates(system, t[::EVERY], states[::EVERY].nan_to_num(0.0, 0.0, 0.0), z_e, every)
    size = rate.square().flatten(4).mean(-1) if rate.dim() > 4 else rate.square()
    return size.mean((0, 2)).sqrt().clamp_min(1e-12)


def decorrelate(states: Tensor) -> Tensor:
    """Decorrelated states: a product of the marginal distributions of the components of trajectories.

    The size of F_a along the data's own trajectories rewards what the expert should say: in a swing that dies away
    angle and speed are correlated, and the smallest F_a with a damping there has a share of the restoring force as
    well.  Where the components are independent it has none.

    Arguments:
        states: (T, S, N, *state).

    Returns:
        the same shape, each component taken from another window and another time: what drives all windows alike makes
        the components of one time dependent.
    """
    axis, (times, _, count) = 3 - states.dim(), states.shape[:3]
    window = torch.arange(count)
    mixed = []
    for k, part in enumerate(states.split(1, dim=axis)):
        moved = (torch.arange(times).unsqueeze(1) + (k + 1) * window) % times
        mixed.append(part.movedim(2, 1)[moved, (window - k) % count].movedim(1, 2))
    return torch.cat(mixed, dim=axis)


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
    inputs = [None] * len(t) if u is None else u
    rates = [system.expert(s, y, z_e, *further(system, y, z_e, k)) for s, y, k in zip(t, states, inputs, strict=True)]
    return torch.stack(rates)


def interaction_at(
    decoder: Decoder, states: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, u: Tensor | None = None
) -> Tensor:
    """F_a at every state (T, S, N, *state) for each of M pairs of z_e (S, M, P) and z_a (S, M, Q):
    (M, T, S, N, *state).  The states are at times t (T,), with known inputs u (T, S, N, U) where there are some."""
    times, seeds, count = states.shape[:3]
    points = states.movedim(1, 0).flatten(1, 2)  # (S, T·N, *state)
    pairs = z_a.shape[1]
    context = decoder.context(z_a, z_e).repeat_interleave(times * count, dim=1)
    when = t.repeat_interleave(count).repeat(pairs)
    inputs = () if u is None else (u.movedim(1, 0).flatten(1, 2).repeat(1, pairs, 1),)
    rates = decoder.interaction_rate(points.repeat(1, pairs, *[1] * (points.dim() - 2)), context, when, *inputs)
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
