"""The library of candidate terms: what a scientist would try in each rate."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.models.terms import Term, quantities
from expertaug.systems import System
from expertaug.systems.inputs import further
from expertaug.trajectories import Trajectories

DRY = 0.05  # of a component's typical size, within which dry friction turns round
PROBES = 16


def rates_of(system: System, kinematics: bool) -> list[str]:
    """Names of the components in whose rates terms are sought.

    Arguments:
        kinematics: whether rates that are another component by the expert's definition, as θ' of a pendulum, count.
    """
    names = [p.name for p in system.state]
    if kinematics:
        return names
    generator = torch.Generator().manual_seed(0)
    y = torch.randn(PROBES, *system.state_shape, generator=generator, dtype=torch.float64)
    sizes = torch.tensor([p.scale for p in system.expert_parameters], dtype=torch.float64)
    z_e = sizes * (0.5 + torch.rand(PROBES, len(sizes), generator=generator, dtype=torch.float64))
    u = torch.randn(PROBES, len(system.known), generator=generator, dtype=torch.float64) if system.known else None
    rate = system.expert(torch.tensor(0.0, dtype=torch.float64), y, z_e, *further(system, y, z_e, u))
    return [n for k, n in enumerate(names) if not any(torch.equal(rate[:, k], y[:, j]) for j in range(len(names)))]


def library(system: System, train: Trajectories, rates: Sequence[str], by_parameters: bool = False) -> list[Term]:
    """Candidates for each rate: a constant, components, sines and cosines of angles, products of two of them, drag
    |x| x and dry friction tanh(x / x0) of what is no angle, known inputs.

    Arguments:
        train: whose typical sizes set x0.
        rates: components in whose rates they stand.
        by_parameters: whether components, inputs and the constant stand there too divided by each positive expert
            parameter: a law of forces, where the expert's parameter is an inertia.
    """
    angles, names = set(system.angles), [p.name for p in system.state]
    moves = [n for n in names if n not in angles]
    linear = ["1", *names, *(p.name for p in system.known)]
    bent = [f"{f}({n})" for n in names if n in angles for f in ("sin", "cos")]
    turned = [f"sin(2*{n})" for n in names if n in angles]
    factors = [*bent, *moves, *(p.name for p in system.known)]
    products = [f"{a}*{b}" for a, b in combinations(factors, 2)] + [f"{n}**2" for n in moves]
    # cos² and sin cos say nothing new beside sin 2θ and the constant.
    own = {f"sin({n})*cos({n})" for n in angles}
    sizes = np.sqrt(np.nanmean(np.square(train.seen, dtype=np.float64), axis=tuple({*range(train.y.ndim)} - {2})))
    rubs = []
    for name in moves:
        size = float(sizes[names.index(name)])
        rubs += [f"abs({name})*{name}", f"{name}**3"]
        rubs += [f"tanh({name}/{DRY * size:.1g})"] if size > 0 else []
    texts = [*linear, *bent, *turned, *(p for p in products if p not in own), *rubs]
    if by_parameters:
        texts += [f"{x}/{p.name}" for p in system.expert_parameters if p.positive for x in linear]
    return [Term(rate, text) for rate in rates for text in dict.fromkeys(texts)]


def column(system: System, term: Term, y: Tensor, z_e: Tensor, u: Tensor | None) -> Tensor:
    """A term's values at states y (…, *state): (…, *cells)."""
    return term.value(quantities(system, y, z_e, u))


def finite(system: System, terms: Sequence[Term], y: Tensor, z_e: Tensor, u: Tensor | None) -> dict[Term, float]:
    """Root mean square over states of those terms that are finite at all of them, and not zero everywhere."""
    sizes = {}
    for term in terms:
        value = column(system, term, y, z_e, u)
        if not isinstance(value, Tensor) or value.shape != y.select(-len(system.state_shape), 0).shape:
            shape = tuple(value.shape) if isinstance(value, Tensor) else type(value).__name__
            wanted = tuple(y.select(-len(system.state_shape), 0).shape)
            raise InputError(f"term '{term}'", f"gives {shape}", f"give a tensor {wanted}, as its components are")
        size = float(value.double().square().mean().sqrt())
        if np.isfinite(size) and size > 0:
            sizes[term] = size
    return sizes
