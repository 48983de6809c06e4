"""Choice between experts: which equation do these windows speak for?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Unpack

import numpy as np
import pandas as pd
import torch

from expertaug.api import arguments
from expertaug.api.arguments import Noise, Ranges, RefinementOptions
from expertaug.api.inference import least_squares
from expertaug.api.trained import TrainedModel
from expertaug.errors import InputError
from expertaug.inference.diagnostics.goodness import Candidate, Choice, choose
from expertaug.inference.least_squares import LeastSquares
from expertaug.inference.shared import groups_of
from expertaug.learning.residuals import differences
from expertaug.models.observation_noise import is_some, noise_of
from expertaug.systems import System
from expertaug.trajectories import Trajectories, points_until
from expertaug.windows import Windows

FEWEST = 3  # points of a half


@dataclass(frozen=True)
class Comparison:
    """Experts compared on the same windows.

    Attributes:
        table: a row for each expert; columns ``held-out log error`` (mean over windows of the log of the squared error
            in units of the noise; near 0 is as good as the noise allows), ``behind`` (median over windows of how much
            it is higher than the best's), ``p``, ``ΔBIC``, ``χ²`` per degree of freedom, ``explains`` and ``as good``.
        chosen: name of the expert that the windows speak for; None where they do not tell.
        says: one sentence.
        choice: all numbers.
    """

    table: pd.DataFrame
    chosen: str | None
    says: str
    choice: Choice

    def __repr__(self) -> str:
        """What it says."""
        return f"Comparison({self.says})"


def compare(
    experts: Mapping[str, System],
    windows: Trajectories,
    *,
    observed_s: float,
    noise: Noise = 0.0,
    priors: Mapping[str, Ranges] | None = None,
    start: Ranges | None = None,
    **options: Unpack[RefinementOptions],  # type: ignore[reportGeneralTypeIssues]  # but for its windows
) -> Comparison:
    """Compare experts by forecasts: each is fitted to the first half of every observed window and forecasts the second.

    Nothing after the observed window is looked at, and no truth.  Experts that forecast as well are told apart by an
    information criterion of fits of the whole windows, where it is decisive.

    Arguments:
        experts: systems of the same state, by the names that are printed.
        windows: what was observed; windows of one trajectory (``id``), or of a stretch of one where there are few,
            count as one.
        observed_s: end of the observed window t1 in s, which is included.
        noise: standard deviation of the data's noise; ``estimated`` where the windows know theirs.
        priors: by expert, ranges [low, high] of its parameters in which fits start; None: they are found.
        start: ranges of first values of components that nobody measured.
        options: see :class:`expertaug.models.fit_settings.RefinementSettings`.

    Raises:
        InputError: fewer than two experts, experts of different states, a prior of none of them, a noise of zero, or
            halves too short to fit.
    """
    data = arguments.trajectories(windows, "windows")
    if not isinstance(experts, Mapping) or len(experts) < 2:
        actual = f"{len(experts)} of them" if isinstance(experts, Mapping) else type(experts).__name__
        raise InputError("experts", f"found {actual}", "give two or more systems by name")
    if unknown := sorted(set(priors or {}) - set(experts)):
        raise InputError(f"priors.{unknown[0]}", "is no expert", f"known: {', '.join(experts)}")
    states = {tuple(p.name for p in system.state) for system in experts.values()}
    if len(states) > 1:
        raise InputError("experts", f"their states differ: {sorted(states)}", "compare experts of the same quantities")
    arguments.check_observed(observed_s, data.t)
    points = points_until(data.t, observed_s)
    half = (points + 1) // 2
    if min(half, points - half) < FEWEST:
        raise InputError("observed_s", f"{points} points lie before it", f"give windows of at least {2 * FEWEST}")
    candidates = {}
    for name, system in experts.items():
        prior = None if priors is None else priors.get(name)
        fits: list[TrainedModel] = [
            least_squares(
                system, data, observed_s=float(data.t[count - 1]), prior=prior, noise=noise, start=start, **options
            )
            for count in (half, points)
        ]
        candidates[name] = _candidate(fits[0], fits[1], data, half, points)
    choice = choose(candidates, groups_of(data))
    return Comparison(_table(choice), choice.chosen, choice.says, choice)


def _candidate(first: TrainedModel, whole: TrainedModel, data: Trajectories, half: int, points: int) -> Candidate:
    """What fits of the first half and of the whole of each window say of an expert."""
    fit = whole.predictor.fit if isinstance(whole.predictor, LeastSquares) else None
    assert fit is not None and whole.refinement is not None, "of least squares"
    if not is_some(noise_of(whole.refinement.noise, whole.system, whole.stored.card)):
        raise InputError("noise", "is zero, and errors are compared with it", "give its standard deviation")
    seen, t = data.seen[:, :points], data.t[:points]
    u = None if data.u is None else data.u[:, :points]
    forecast = np.asarray(first.forecast(seen[:, :half], t, u=u).y)
    predicted, measured = (torch.from_numpy(y).movedim(1, 0).unsqueeze(1).double()[half:] for y in (forecast, seen))
    errors, mask = differences(whole.system, predicted, measured)
    squares = (errors / fit.observed_noise).square().movedim(2, 0).flatten(1)
    count = squares.shape[1] if mask is None else mask.movedim(2, 0).flatten(1).sum(1).clamp_min(1)
    whole_forecast = whole.forecast(seen, t, u=u)
    assert whole_forecast.chi2 is not None, "of least squares"
    missing = fit.missing(Windows.of(data).until(points).joined)[0]
    return Candidate(
        held_out=(squares.sum(1) / count).numpy(),
        chi2=np.asarray(whole_forecast.chi2, dtype=float),
        observations=fit.observations - missing.numpy(),
        parameters=fit.sizes[0] + fit.sizes[2],
        overdispersion=max([1.0, *(whole.refinement.overdispersion or [])]),
    )


def _table(choice: Choice) -> pd.DataFrame:
    rows = {
        name: {
            "held-out log error": choice.score[name],
            "behind": choice.behind[name],
            "p": choice.p[name],
            "ΔBIC": choice.criterion[name],
            "χ²": choice.goodness[name].chi2,
            "explains": choice.goodness[name].explains,
            "as good": name in choice.as_good,
        }
        for name in choice.score
    }
    return pd.DataFrame.from_dict(rows, orient="index").sort_values("held-out log error")
