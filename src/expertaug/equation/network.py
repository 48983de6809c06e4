"""F_a's values at the states that training windows visit, as a linear problem in candidate terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from expertaug.equation.library import column
from expertaug.equation.selection import Candidates, by_regression, remainder
from expertaug.equation.shooting import Formula
from expertaug.inference.joint_fit import NormalEquations
from expertaug.models.decoder import Decoder
from expertaug.models.posterior import Estimates
from expertaug.models.terms import Term
from expertaug.systems import System
from expertaug.systems.inputs import further

MOVE = 1e-4  # of an expert parameter, for the derivative of its rates
BYTES = 2**27  # of the columns at a time


@dataclass(frozen=True)
class Learned:
    """What a network F_a of one seed does at N windows.

    Attributes:
        columns: the linear problem F_a ≈ Σ c f over the visited states, with the expert's own parameters beside the
            terms: what they can do is no new term.
        numbers: of values of F_a.
        own: whether a coefficient may be each window's own.
    """

    columns: Candidates
    numbers: int
    own: bool

    def formulas(self, most: int) -> list[Formula]:
        """Of one term, of two, …, as they explain F_a."""
        return by_regression(self.columns, self.numbers, most, self.own)

    def explained(self, formula: Formula) -> float:
        """Share of F_a's square that a formula's terms explain, their coefficients being free."""
        places = dict(self.columns.terms)
        return 1.0 - remainder(self.columns, formula, places) / float(self.columns.equations.cost.sum())


@torch.no_grad()
def describe_learned(
    decoder: Decoder,
    estimates: Estimates,
    states: Tensor,
    t: Tensor,
    u: Tensor | None,
    terms: Sequence[Term],
    sizes: Tensor,
    shared: Sequence[int],
    own: bool,
) -> list[Learned]:
    """What each seed's F_a does.

    Arguments:
        decoder: with F_a.
        estimates: of N windows.
        states: forecasts of them, (T, S, N, *state).
        t: times in s, (T,).
        u: known inputs (T, S, N, U); None for a system without.
        terms: candidates.
        sizes: of the rates of each component, (K,), by which they are weighed.
        shared: places of the expert's parameters that all windows share.
        own: whether a coefficient may be each window's own.
    """
    system = decoder.system
    assert decoder.interaction is not None and estimates.z_e is not None and estimates.z_a is not None
    context = decoder.context(estimates.z_a, estimates.z_e)
    values = [
        decoder.interaction_rate(y, context, t[k].to(y), None if u is None else u[k]) for k, y in enumerate(states)
    ]
    pushed = torch.stack(values).double()
    rates = list(dict.fromkeys(term.rate for term in terms))
    names = [p.name for p in system.state]
    acts = [names.index(rate) for rate in rates]
    expert, lead = len(system.expert_parameters), -len(system.state_shape)
    places = tuple((term, expert + k) for k, term in enumerate(terms))
    base = tuple((k, k in shared) for k in range(expert))
    per_window = states[:, 0, 0].numel() * 8 * (expert + len(terms) + 1)
    size, each = max(1, BYTES // per_window), []
    for seed in range(states.shape[1]):
        parts = []
        for first in range(0, states.shape[2], size):
            part = slice(first, first + size)
            y, z_e = states[:, seed, part].double(), estimates.z_e[seed, part].double()
            inputs = None if u is None else u[:, seed, part].double()
            design = _design(system, terms, acts, y, z_e, inputs, t)  # (K, T, N, rates, *cells)
            wide = sizes[acts].view(-1, *[1] * (-lead - 1))
            design = (design / wide).movedim(2, 0).flatten(2)  # (N, K, M)
            aim = (pushed[:, seed, part].index_select(lead, torch.tensor(acts)) / wide).movedim(1, 0).flatten(1)
            parts.append(
                (aim.square().sum(1), design @ design.mT, (design @ aim.unsqueeze(-1)).squeeze(-1), aim.numel())
            )
        equations = NormalEquations(*(torch.cat([piece[k] for piece in parts]) for k in range(3)))
        each.append(Learned(Candidates(equations, base, places), sum(piece[3] for piece in parts), own))
    return each


def _design(
    system: System,
    terms: Sequence[Term],
    acts: Sequence[int],
    y: Tensor,
    z_e: Tensor,
    u: Tensor | None,
    t: Tensor,
) -> Tensor:
    """What the expert's parameters and the terms add to the rates that have terms, (P + L, T, N, rates, *cells)."""
    lead, names = -len(system.state_shape), [p.name for p in system.state]
    parameters = z_e.expand(*y.shape[:1], *z_e.shape)
    when = t.to(y).view(-1, 1).expand(y.shape[:2])

    def expert(values: Tensor) -> Tensor:
        rate = system.expert(when, y, values, *further(system, y, values, u))
        return rate.index_select(lead, torch.tensor(acts))

    rate, columns = expert(parameters), []
    for k, parameter in enumerate(system.expert_parameters):
        moved = parameters.clone()
        moved[..., k] += MOVE * parameter.scale
        columns.append((expert(moved) - rate) / MOVE)
    for term in terms:
        added = torch.zeros_like(rate)
        added.select(lead, acts.index(names.index(term.rate))).copy_(column(system, term, y, parameters, u))
        columns.append(added)
    return torch.stack(columns)
