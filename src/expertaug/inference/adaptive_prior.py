"""An augmentation prior that finds its own width, and the stage own-prior, which writes its ranges.

They grow from unlabelled windows of where a model is to work, or without such windows as far as a budget goes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from expertaug import systems
from expertaug.errors import InputError
from expertaug.files import write_text
from expertaug.inference.flow import load
from expertaug.inference.least_squares import LeastSquares, estimator_of
from expertaug.inference.settings import FirstPriorJob, OwnPriorJob, OwnWindows
from expertaug.inference.simulations import LOST, draw_simulations
from expertaug.learning.train import Calibration, describe_recipe, make_expert_alone
from expertaug.models.fit_settings import RefinementSettings
from expertaug.models.observation_noise import GivenNoise
from expertaug.models.store import StoredModel, device_of
from expertaug.systems import Parameter, System
from expertaug.trajectories import SetFolder, Trajectories
from expertaug.windows import Windows

Range = tuple[float, float]
WIDEN = 1.5  # a search goes so far beyond what is known: by this factor, or this share of the width
ROUNDS = 8
TAIL = 0.01  # of estimates that a range leaves out at each end: single windows may be anywhere
FALSE_ALARMS = 0.01  # of training windows that count as unexplained
NEAR = 0.02  # of a range's width: what goes no further beyond it is within
MARGIN = 0.1  # of its width by which the range that is found is widened at each end
TRIED = 100  # own windows in each range that is tried without windows
EXPLAINED = 0.5  # of them must be explained
STARTS = 256  # in such a range
DECADE = 10.0  # factor around a parameter's typical size
SAMPLES = 200  # windows of each set that are fitted, at most, evenly spread


@dataclass(frozen=True)
class AdaptivePrior:
    """Ranges of p⁺ and how far they can be trusted.

    Attributes:
        ranges: [low, high] by parameter, in its unit.
        training: the ranges of the training windows' estimates, from which they grew.
        explained: share of the windows (over all seeds) that the model explains with a z_e in these ranges as well as
            it explains its training windows.
        limit: χ² per degree of freedom up to which a window counts as explained.
        rounds: searches that were made.
        windows: whether there were any; without, ranges end at a budget, or where the model's own windows run away or
            are explained no longer.
    """

    ranges: dict[str, Range]
    training: dict[str, Range]
    explained: float
    limit: float
    rounds: int
    windows: bool = True

    @property
    def says(self) -> str:
        """One sentence."""
        grown = ", ".join(f"{name} in [{low:.3g}, {high:.3g}]" for name, (low, high) in self.ranges.items())
        if not self.windows:
            return f"no windows were given: the ranges were widened to {grown}"
        share = f"{100 * self.explained:.0f} % of the windows"
        if self.explained < 0.5:
            return f"the model explains {share} even with {grown}: the expert with its F_a does not fit the others"
        return f"the model explains {share} with {grown}"


def adapt_prior(
    stored: StoredModel,
    train: Windows,
    windows: Windows,
    noise: GivenNoise,
    first: Mapping[str, Sequence[float]] | None = None,
    settings: Mapping | RefinementSettings | None = None,
) -> AdaptivePrior:
    """Grow the ranges of z_e from the training windows' until the model explains the given windows, or no more of them.

    Every round fits the windows with starts in ranges that are wider than those known so far; the estimates of windows
    that are explained (χ² below what nearly all training windows have) widen them.

    Arguments:
        stored: a trained model, or the expert alone.
        train: observed windows of the training, y (T1, 1, N, *state).
        windows: observed windows of where the model is to work, y (T1, 1, M, *state); nothing else is known of them.
        noise: standard deviation of the data's noise.
        first: ranges by parameter in which fits of the training windows start; None: at the model's own estimates.
        settings: see :class:`RefinementSettings`.

    Raises:
        InputError: the expert alone without first ranges, or windows of another shape.
    """
    parameters = stored.model.system.expert_parameters
    own, others = tuple(train.seed(0).y.shape), tuple(windows.seed(0).y.shape)
    if own[0] != others[0] or own[2:] != others[2:]:
        raise InputError("windows", f"windows of shape {others}", f"the training's are {own}, (T1, N, *state)")
    training, limit = _of_training(stored, train, noise, first, settings)
    ranges = training
    explained, rounds = 0.0, 0
    while rounds < ROUNDS:
        rounds += 1
        search = _widen(parameters, ranges, WIDEN)
        z_e, chi2 = _estimate(estimator_of(stored, settings, noise, search), windows.expand(len(stored.seeds)))
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
    prior = {}
    for p in parameters:
        new, old = ranges[p.name] if explained else training[p.name], training[p.name]
        prior[p.name] = _with_margin(p, new) if _beyond(new, old) > NEAR else old
    return AdaptivePrior(prior, training, explained, limit, rounds)


def widen_prior(
    stored: StoredModel,
    train: Windows,
    noise: GivenNoise,
    budget: float,
    first: Mapping[str, Sequence[float]] | None = None,
    settings: Mapping | RefinementSettings | None = None,
) -> AdaptivePrior:
    """Widen the ranges of z_e from the training windows' by a factor, as far as the model can be followed.

    Every round goes on by a factor, until the budget is spent or the windows that the model itself makes in the ranges
    run away, or are not explained by fits that start there: what cannot be inferred is of no use.

    Arguments:
        stored, noise, first, settings: as of :func:`adapt_prior`.
        train: trajectories of the training, y (T, 1, N, *state).
        budget: factor, > 1, by which the ranges go beyond the training's: a positive parameter's ends are divided and
            multiplied by it, another's width is.

    Raises:
        InputError: the expert alone without first ranges, or a budget that is no widening.
    """
    if not budget > 1:
        raise InputError("budget", f"found {budget:g}", "give a factor above 1, as 2")
    observed = stored.card.observed
    parameters = stored.model.system.expert_parameters
    training, limit = _of_training(stored, train.until(observed), noise, first, settings)
    ranges, explained, rounds, factor = training, 0.0, 0, 1.0
    while factor < budget:
        factor, rounds = min(factor * WIDEN, budget), rounds + 1
        wide = _widen(parameters, training, factor)
        estimator = estimator_of(stored, settings, noise, wide)
        made, _ = draw_simulations(replace(stored, model=estimator), train, OwnWindows.of(prior=wide), noise, TRIED)
        if made.y.shape[2] < (1 - LOST) * TRIED:
            break
        share = float((_estimate(estimator, made.until(observed))[1] <= limit).double().mean())
        if share < EXPLAINED:
            break
        ranges, explained = wide, share
    return AdaptivePrior(ranges, training, explained, limit, rounds, windows=False)


def with_more_starts(settings: RefinementSettings) -> RefinementSettings:
    """Settings of fits that start in a :func:`typical_ranges`: more starts."""
    starts = settings.starts if "starts" in settings.model_fields_set else 0
    return settings.model_copy(update={"starts": max(starts, STARTS)})


def typical_ranges(system: System) -> dict[str, Range]:
    """Where fits start when nothing is known of z_e but its typical size: a decade to both sides."""
    ranges = {}
    for p in system.expert_parameters:
        ranges[p.name] = (p.scale / DECADE, p.scale * DECADE) if p.positive else (-DECADE * p.scale, DECADE * p.scale)
    return ranges


def _of_training(
    stored: StoredModel,
    train: Windows,
    noise: GivenNoise,
    first: Mapping[str, Sequence[float]] | None,
    settings: Mapping | RefinementSettings | None,
) -> tuple[dict[str, Range], float]:
    """Ranges of the training windows' estimates, and the χ² up to which a window counts as explained."""
    if stored.kind.is_classical() and first is None:
        raise InputError("first", "missing", "the expert alone has no estimates to start from: give ranges")
    first = first or (None if stored.card.refinement is None else stored.card.refinement.prior)  # of kind alternating
    ranges = None if first is None else {name: (float(low), float(high)) for name, (low, high) in first.items()}
    z_e, chi2 = _estimate(estimator_of(stored, settings, noise, ranges), train.expand(len(stored.seeds)))
    return _hull(stored.model.system.expert_parameters, z_e), float(torch.quantile(chi2, 1 - FALSE_ALARMS))


def _estimate(estimator: LeastSquares, windows: Windows) -> tuple[Tensor, Tensor]:
    """z_e (S·N, P) and χ² (S·N,) of windows, y (T1, S, N, *state)."""
    estimates = estimator.estimate(windows)
    assert estimates.z_e is not None and estimates.chi2 is not None
    return estimates.z_e.flatten(0, 1).double(), estimates.chi2.flatten().double()


def _hull(parameters: Sequence[Parameter], z_e: Tensor) -> dict[str, Range]:
    """Where nearly all estimates (N, P) lie."""
    low, high = torch.quantile(z_e, torch.tensor([TAIL, 1 - TAIL], dtype=z_e.dtype), dim=0)
    return {p.name: (float(low[k]), float(high[k])) for k, p in enumerate(parameters)}


def _union(first: Mapping[str, Range], second: Mapping[str, Range]) -> dict[str, Range]:
    return {name: (min(first[name][0], second[name][0]), max(first[name][1], second[name][1])) for name in first}


def _beyond(new: Range, old: Range) -> float:
    """How far a range goes beyond another, as a share of that one's width."""
    width = max(old[1] - old[0], 1e-12)
    return max(old[0] - new[0], new[1] - old[1], 0.0) / width


def _widen(parameters: Sequence[Parameter], ranges: Mapping[str, Range], factor: float) -> dict[str, Range]:
    """Ranges that go further at both ends: by a factor where a parameter is positive, else by a share of the width."""
    wide = {}
    for p in parameters:
        low, high = ranges[p.name]
        step = (factor - 1) * (high - low)
        wide[p.name] = (max(low / factor, 1e-12), high * factor) if p.positive else (low - step, high + step)
    return wide


def _with_margin(parameter: Parameter, interval: Range) -> Range:
    low, high = interval
    step = MARGIN * (high - low)
    lower = low - step
    return (max(lower, low / (1 + MARGIN)) if parameter.positive else lower, high + step)


def run_stage(
    model: Path | None, data: Path, output: Path, settings: OwnPriorJob, calibration: Path | None = None
) -> AdaptivePrior:
    """Stage: find the ranges of p⁺ and write them.

    Arguments:
        model: file of a trained model; None: the expert alone, before anything is trained.
        data: folder of the sets; of those that ``windows`` names only the observed part is used.
        output: JSON {ranges, training, explained, limit, rounds, windows, says}.
        settings: of the job; for the expert alone a :class:`FirstPriorJob`.
        calibration: JSON whose ``constants`` complete the system's settings.
    """
    sets = SetFolder(data)
    train = sets["train"]
    if isinstance(settings, FirstPriorJob):
        described = describe_recipe(settings, None if calibration is None else Calibration.load(calibration))
        stored = make_expert_alone(systems.load(described.system), train, settings.expert, described)
    else:
        assert model is not None, "a job of the expert alone says what it is"
        stored = load(model, device_of(settings.device), settings.classes or ())
    prior = find_prior(stored, train, (sets[name] for name in settings.windows), settings)
    write_text(Path(output), json.dumps({**asdict(prior), "says": prior.says}, indent=2) + "\n")
    return prior


def find_prior(
    stored: StoredModel, train: Trajectories, sets: Iterable[Trajectories], settings: OwnPriorJob
) -> AdaptivePrior:
    """Find the ranges of p⁺.

    Arguments:
        stored: a trained model; of a :class:`FirstPriorJob` the expert alone.
        train: the training set.
        sets: those whose observed windows are to be covered; none: the ranges are widened up to the job's budget.
    """
    first = typical_ranges(stored.model.system)  # beside the model's own estimates, which may be wrong
    noise, training_windows, observed = settings.noise, _trajectories(train), stored.card.observed
    alone = isinstance(settings, FirstPriorJob)
    how = with_more_starts(settings.refinement) if alone else settings.refinement
    windows = [_trajectories(data).until(observed) for data in sets]
    if windows:
        return adapt_prior(stored, training_windows.until(observed), Windows.cat(windows), noise, first, how)
    return widen_prior(stored, training_windows, noise, settings.budget, first, how)


def _trajectories(data: Trajectories) -> Windows:
    """At most so many trajectories, y (T, 1, N, *state)."""
    index = np.linspace(0, len(data) - 1, min(SAMPLES, len(data))).astype(int)
    return Windows.of(data.subset(index))
