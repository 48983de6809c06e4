"""An augmentation prior that finds its own width, from unlabelled windows of where a model is to work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.least_squares import estimator_of
from expertaug.inference.settings import RefinementSettings
from expertaug.models.store import StoredModel
from expertaug.systems import Parameter

Range = tuple[float, float]
WIDEN = 1.5  # a search goes so far beyond what is known: by this factor, or this share of the width
ROUNDS = 8
TAIL = 0.01  # of estimates that a range leaves out at each end: single windows may be anywhere
FALSE_ALARMS = 0.01  # of training windows that count as unexplained
NEAR = 0.02  # of a range's width: what goes no further beyond it is within
MARGIN = 0.1  # of its width by which the range that is found is widened at each end


@dataclass(frozen=True)
class OwnPrior:
    """Ranges of p⁺ and how far they can be trusted.

    Attributes:
        ranges: [low, high] by parameter, in its unit.
        training: the ranges of the training windows' estimates, from which they grew.
        explained: share of the windows (over all seeds) that the model explains with a z_e in these ranges as well as
            it explains its training windows.
        limit: χ² per degree of freedom up to which a window counts as explained.
        rounds: searches that were made.
    """

    ranges: dict[str, Range]
    training: dict[str, Range]
    explained: float
    limit: float
    rounds: int

    @property
    def says(self) -> str:
        """One sentence."""
        grown = ", ".join(f"{name} in [{low:.3g}, {high:.3g}]" for name, (low, high) in self.ranges.items())
        share = f"{100 * self.explained:.0f} % of the windows"
        if self.explained < 0.5:
            return f"the model explains {share} even with {grown}: the expert with its F_a does not fit the others"
        return f"the model explains {share} with {grown}"


def own_prior(
    stored: StoredModel,
    train: Tensor,
    windows: Tensor,
    noise: float | Mapping[str, float] | str,
    first: Mapping[str, Sequence[float]] | None = None,
    settings: Mapping | RefinementSettings | None = None,
) -> OwnPrior:
    """Grow the ranges of z_e from the training windows' until the model explains the given windows, or no more of them.

    Every round fits the windows with starts in ranges that are wider than those known so far; the estimates of windows
    that are explained (χ² below what nearly all training windows have) widen them.

    Arguments:
        stored: a trained model, or the expert alone.
        train: observed windows of the training, (T1, N, *observed), known inputs as further components of the state.
        windows: observed windows of where the model is to work, (T1, M, *observed); nothing else is known of them.
        noise: standard deviation of the data's noise.
        first: ranges by parameter in which fits of the training windows start; None: at the model's own estimates.
        settings: see :class:`RefinementSettings`.

    Raises:
        InputError: the expert alone without first ranges, or windows of another shape.
    """
    parameters = stored.model.system.expert_parameters
    if stored.description["kind"] == "least_squares" and first is None:
        raise InputError("first", "missing", "the expert alone has no estimates to start from: give ranges")
    if train.shape[0] != windows.shape[0] or train.shape[2:] != windows.shape[2:]:
        found = f"windows of shape {tuple(windows.shape)}"
        raise InputError("windows", found, f"the training's are {tuple(train.shape)}, (T1, N, *state)")
    seeds = len(stored.seeds)

    def estimated(y: Tensor, prior: Mapping[str, Sequence[float]] | None) -> tuple[Tensor, Tensor]:
        """z_e (S·N, P) and χ² (S·N,)."""
        ranges = None if prior is None else {name: (float(low), float(high)) for name, (low, high) in prior.items()}
        found = estimator_of(stored, settings, noise, ranges).estimate(y.unsqueeze(1).expand(-1, seeds, *y.shape[1:]))
        assert found.z_e is not None and found.chi2 is not None
        return found.z_e.flatten(0, 1).double(), found.chi2.flatten().double()

    z_e, chi2 = estimated(train, first)
    limit = float(torch.quantile(chi2, 1 - FALSE_ALARMS))
    training = ranges = _hull(parameters, z_e)
    explained, rounds = 0.0, 0
    while rounds < ROUNDS:
        rounds += 1
        search = _widened(parameters, ranges, WIDEN)
        z_e, chi2 = estimated(windows, search)
        good = chi2 <= limit
        share = float(good.double().mean())
        if not good.any():
            ranges = search  # nothing there: look further
            continue
        new = _union(ranges if explained else training, _hull(parameters, z_e[good]))
        grown = any(_beyond(new[p.name], ranges[p.name]) > NEAR for p in parameters)
        ranges, done = new if grown else ranges, not grown and share <= explained + 0.01
        explained = max(share, explained)
        if done:
            break
    found = {}
    for p in parameters:
        new, old = ranges[p.name] if explained else training[p.name], training[p.name]
        found[p.name] = _with_margin(p, new) if _beyond(new, old) > NEAR else old
    return OwnPrior(found, training, explained, limit, rounds)


def _hull(parameters: Sequence[Parameter], z_e: Tensor) -> dict[str, Range]:
    """Where nearly all estimates (N, P) lie."""
    low, high = torch.quantile(z_e, torch.tensor([TAIL, 1 - TAIL], dtype=z_e.dtype), dim=0)
    return {p.name: (float(low[k]), float(high[k])) for k, p in enumerate(parameters)}


def _union(one: Mapping[str, Range], other: Mapping[str, Range]) -> dict[str, Range]:
    return {name: (min(one[name][0], other[name][0]), max(one[name][1], other[name][1])) for name in one}


def _beyond(new: Range, old: Range) -> float:
    """How far a range goes beyond another, as a share of that one's width."""
    width = max(old[1] - old[0], 1e-12)
    return max(old[0] - new[0], new[1] - old[1], 0.0) / width


def _widened(parameters: Sequence[Parameter], ranges: Mapping[str, Range], factor: float) -> dict[str, Range]:
    """Ranges that go further at both ends: by a factor where a parameter is positive, else by a share of the width."""
    wide = {}
    for p in parameters:
        low, high = ranges[p.name]
        step = (factor - 1) * (high - low)
        wide[p.name] = (max(low / factor, 1e-12), high * factor) if p.positive else (low - step, high + step)
    return wide


def _with_margin(parameter: Parameter, found: Range) -> Range:
    low, high = found
    step = MARGIN * (high - low)
    lower = low - step
    return (max(lower, low / (1 + MARGIN)) if parameter.positive else lower, high + step)
