"""Metrics: what each is called, how it is printed and where, and how it is computed from the forecasts of a set.

A family has a member for each parameter or level, whose name stands in place of ``{of}``.  Tables are made without
torch, which is loaded here by what computes alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from expertaug.errors import InputError
from expertaug.evaluation.intervals import Resampled, log_mean, log_median, mean
from expertaug.evaluation.settings import CONVENTIONS

if TYPE_CHECKING:
    from torch import Tensor

    from expertaug.systems import System

OF = "{of}"
METRICS: list[Metric] = []
_LOG = {"digits": 2, "is_log": True, "better": "lower"}


class Shown(Enum):
    """Where tables print a metric."""

    FIRST = "in an experiment's first table and in figures"
    WHERE_ANY = "in the first table, where any value is above 0"
    LAST = "in the first table's last column, of one set"
    FURTHER = "in the table of further metrics"


@dataclass(frozen=True)
class Outcome:
    """What the forecasts of a set by S seeds came to.

    Attributes:
        system: that is forecast.
        errors: squared error of each sample, summed over the observed dimensions, (S, N); NaN where nothing was
            measured.
        misfit: the same over the observed window after its first point.
        after: the same after the observed window, (S, N), where ``errors`` begin before.
        diverged: whether a forecast did, (S, N).
        estimate_ms: processor time in which one seed estimates a window; None of a model that estimates nothing.
        z_e, truth: estimates (S, N, P) and true expert parameters (1, N, P), where the model knows them.
        drawn: averages over windows of the scores of drawn forecasts, by metric or by member of a family, each (S,).
        outside: whether a window's estimates lie outside the training windows' (:mod:`expertaug.models.support`),
            (S, N); None where that is not known.
        doubtful: whether a window's fit is (:class:`expertaug.models.doubts.FitDoubts`), (S, N); None where none is
            made.
        with_truth: squared errors of K samples with the true z_e and with the estimated, (2, S, K).
        expert_share: share of F_a that another z_e would say (:mod:`expertaug.learning.expert_share`), (S,).
    """

    system: System
    errors: Tensor
    misfit: Tensor
    after: Tensor | None
    diverged: Tensor
    estimate_ms: float | None = None
    z_e: Tensor | None = None
    truth: Tensor | None = None
    drawn: Mapping[str, Any] | None = None
    outside: Tensor | None = None
    doubtful: Tensor | None = None
    with_truth: Tensor | None = None
    expert_share: Tensor | None = None


@dataclass(frozen=True)
class SampleErrors:
    """Errors of every sample of a set: squared ones (S, N), relative ones of parameters in % (S, N, P) or None."""

    errors: np.ndarray
    relative: np.ndarray | None
    parameters: list[str]


Statistic = tuple[Callable[[np.ndarray, np.ndarray], Resampled], np.ndarray]


@dataclass(frozen=True)
class Metric:
    """A number that says how good forecasts or estimates are.

    Attributes:
        name: in files; of a family with ``{of}``.
        title: as printed, without its unit.
        unit: of the printed number; None: that of the parameter.
        compute: an outcome → (S,), or of a family by member; None where it does not apply.
        better: which direction is; None where it is no merit.
        shown: where.
        digits: after the point; None: three of the mean.
        factor: from the number to the printed one.
        convention: of the log-MSE, where another convention has its own metric.
        is_log: whether it is a natural logarithm, which is also told by its name in the table of further metrics.
        not_negative: whether it cannot be.
        note: what a table says that prints it.
        of_job: whether all seeds of a job share its value.
        samples: errors of samples and member → statistic over samples and values (S, N), for intervals; None where
            samples are not kept.
        like: the metric from which it differs by a constant.
        family, of: of a member.
    """

    name: str
    title: str
    unit: str | None = ""
    compute: Callable[[Outcome], Any] = lambda outcome: None
    better: Literal["lower", "higher"] | None = None
    shown: Shown = Shown.FURTHER
    digits: int | None = None
    factor: float = 1.0
    convention: str | None = None
    is_log: bool = False
    not_negative: bool = False
    note: str = ""
    of_job: bool = False
    samples: Callable[[SampleErrors, str], Statistic | None] = lambda errors, of: None
    like: str | None = None
    family: Metric | None = None
    of: str = ""

    def member(self, of: str) -> Metric:
        """The metric of a parameter or level."""
        return replace(self, name=self.name.replace(OF, of), title=self.title.replace(OF, of), family=self, of=of)

    def heading(self, units: Mapping[str, str] | None = None) -> str:
        """Title and unit, as printed; ``units`` are those of the parameters."""
        unit = (units or {}).get(self.of, f"unit of {self.of}") if self.unit is None else self.unit
        return f"{self.title} [{unit}]" if unit else self.title

    def format(self, about: float) -> Callable[[float], str]:
        """How numbers are printed beside the mean ``about``."""
        digits, factor = self.digits, self.factor
        if digits is None:
            digits = min(max(2 - math.floor(math.log10(abs(about))) if about else 2, 0), 12)
        return lambda value: f"{factor * value:.{digits}f}"


def register(metric: Metric) -> Metric:
    """Add a metric: ``evaluate`` computes it of every set, tables print it; their order is that of registration."""
    if any(metric.name == registered.name for registered in METRICS):
        raise ValueError(f"there is a metric {metric.name!r} already")
    METRICS.append(metric)
    metric_of.cache_clear()
    return metric


@cache
def metric_of(name: str) -> Metric:
    """The metric of this name; one that nobody registered is printed as it is called."""
    for metric in METRICS:
        begin, family, end = metric.name.partition(OF)
        if name == metric.name:
            return metric
        if family and name.startswith(begin) and name.endswith(end) and len(name) > len(begin + end):
            return metric.member(name[len(begin) : len(name) - len(end)])
    return Metric(name, name)


def values_of(outcome: Outcome) -> dict[str, Tensor]:
    """Every registered metric of an outcome that applies to it, by name, each (S,)."""
    import torch

    values: dict[str, Tensor] = {}
    for metric in METRICS:
        value = metric.compute(outcome)
        if OF in metric.name:
            values |= {metric.member(of).name: torch.as_tensor(each) for of, each in (value or {}).items()}
        elif value is not None:
            values[metric.name] = torch.as_tensor(value)
    return values


def log_mse_of(convention: str) -> Metric:
    """The log-MSE of a convention, which tables and figures show.

    Raises:
        InputError: there is no such convention.
    """
    if convention not in CONVENTIONS:
        raise InputError("convention", f"{convention!r}", f"one of {', '.join(CONVENTIONS)}")
    return LOG_MSE[convention]


def first_metrics(metrics: Iterable[str], convention: str) -> list[str]:
    """Those metrics that figures and first tables show: the log-MSE in a convention, then others."""
    names, own = set(metrics), log_mse_of(convention)
    shown = [m for m in METRICS if m.shown is Shown.FIRST and m.convention in (None, own.convention)]
    return [m.name for m in shown if m.name in names]


def log_mse(system: System, prediction: Tensor, truth: Tensor) -> dict[str, Tensor]:
    """Natural log of the mean, over samples and times, of the squared error, in both conventions.

    ``log_mse_sum`` sums the squared error over the observed dimensions (the paper's tables), ``log_mse_dim`` divides
    the sum by :attr:`System.error_dims` first.

    Arguments:
        prediction, truth: states (T, S, N, *state).

    Returns:
        name → (S,).
    """
    from expertaug.learning.residuals import squared_errors

    summed = log_of_mean(squared_errors(system, prediction, truth))
    return {LOG_MSE["sum"].name: summed, LOG_MSE["dim"].name: per_dimension(summed, system)}


def parameter_errors(system: System, estimate: Tensor, truth: Tensor) -> dict[str, Tensor]:
    """Errors of the expert parameters.

    ``relative_error`` is the paper's: the mean over samples and parameters of |z − ẑ| / |z|, in %; it is dominated by
    samples with z near 0 where a parameter can vanish, so ``rmse_<name>`` stands beside it, in the parameter's unit.

    Arguments:
        estimate, truth: (S, N, P); a truth of NaN is not known and does not count.

    Returns:
        name → (S,); nothing of a parameter that no sample knows.
    """
    nothing = estimate[..., 0]
    outcome = Outcome(system, nothing, nothing, None, nothing, z_e=estimate, truth=truth)
    relative, rmse, together = _errors_of_parameters(outcome)
    errors = {} if together is None else {RELATIVE_ERROR.name: together}
    errors |= {RELATIVE_ERROR_OF.member(of).name: value for of, value in relative.items()}
    return errors | {RMSE_OF.member(of).name: value for of, value in rmse.items()}


def measured_errors(errors: Tensor) -> Tensor:
    """Errors (S, N) of the samples of which anything was measured at these times."""
    unknown = errors.isnan().all(0)
    return errors[:, ~unknown] if unknown.any() else errors


def log_of_mean(errors: Tensor) -> Tensor:
    """Natural logarithm of the mean over samples, (S,), of errors (S, N)."""
    return measured_errors(errors).mean(1).log()


def per_dimension(value: Tensor, system: System) -> Tensor:
    """A log-MSE, (S,), whose squared errors are averaged over :attr:`System.error_dims` instead of summed."""
    import torch

    return value - torch.log(torch.tensor(float(system.error_dims)))


def _log_of_median(errors: Tensor) -> Tensor:
    return measured_errors(errors).quantile(0.5, dim=1).log()


def _errors_of_parameters(outcome: Outcome) -> tuple[dict[str, Tensor], dict[str, Tensor], Tensor | None]:
    """Mean of |z − ẑ| / |z| in % and root of the mean square by parameter, each (S,), of the samples and parameters
    whose truth is known; and the mean of the first over parameters."""
    import torch

    estimate, truth = outcome.z_e, outcome.truth
    names = [p.name for p in outcome.system.expert_parameters]
    if estimate is None or truth is None or not names:
        return {}, {}, None
    if not truth.isnan().any():
        each = 100 * ((estimate - truth) / truth).abs().double().mean(1)
        rms = (estimate - truth).double().square().mean(1).sqrt()
        columns = [{name: value[:, k] for k, name in enumerate(names)} for value in (each, rms)]
        return columns[0], columns[1], each.mean(1)
    relative, rmse = {}, {}
    for k, name in enumerate(names):
        has_truth = ~truth[0, :, k].isnan()
        if has_truth.any():
            far = (estimate[:, has_truth, k] - truth[:, has_truth, k]).double()
            relative[name] = 100 * (far / truth[:, has_truth, k]).abs().mean(1)
            rmse[name] = far.square().mean(1).sqrt()
    return relative, rmse, torch.stack(list(relative.values())).mean(0) if relative else None


def _relative_samples(errors: SampleErrors, of: str) -> Statistic | None:
    if errors.relative is None:
        return None
    if of:
        return (mean, errors.relative[..., errors.parameters.index(of)]) if of in errors.parameters else None
    unknown = np.isnan(errors.relative)
    if not unknown.any():
        return mean, errors.relative.mean(2)
    count = np.where(unknown.all(2), np.nan, (~unknown).sum(2))
    return mean, np.where(unknown, 0.0, errors.relative).sum(2) / count


def _of_draws(name: str) -> Callable[[Outcome], Any]:
    return lambda outcome: None if outcome.drawn is None else outcome.drawn[name]


LOG_MSE = {
    "sum": register(
        Metric(
            "log_mse_sum",
            "log-MSE",
            compute=lambda o: log_of_mean(o.errors),
            shown=Shown.FIRST,
            convention="sum",
            samples=lambda errors, of: (log_mean, errors.errors),
            **_LOG,
        )
    ),
    "dim": register(
        Metric(
            "log_mse_dim",
            "log-MSE",
            compute=lambda o: per_dimension(log_of_mean(o.errors), o.system),
            shown=Shown.FIRST,
            convention="dim",
            like="log_mse_sum",
            **_LOG,
        )
    ),
}
register(Metric("log_mse_observed", "log-MSE, observed window", compute=lambda o: log_of_mean(o.misfit), **_LOG))
register(
    Metric(
        "log_mse_after_sum",
        "log-MSE, after t1 alone",
        compute=lambda o: None if o.after is None else log_of_mean(o.after),
        **_LOG,
    )
)
register(
    Metric(
        "log_mse_after_dim",
        "log-MSE, after t1 alone",
        compute=lambda o: None if o.after is None else per_dimension(log_of_mean(o.after), o.system),
        **_LOG,
    )
)
register(
    Metric(
        "log_mse_median",
        "log-MSE, median sample",
        compute=lambda o: _log_of_median(o.errors),
        samples=lambda errors, of: (log_median, errors.errors),
        **_LOG,
    )
)
register(
    Metric(
        "log_mse_median_dim",
        "log-MSE, median sample",
        compute=lambda o: per_dimension(_log_of_median(o.errors), o.system),
        like="log_mse_median",
        **_LOG,
    )
)
DIVERGED = register(
    Metric(
        "runaway_share",
        "runaways",
        "%",
        note="Runaways: forecasts that leave ten times the training set's largest values, or have no solution; they "
        "count with the error that they have at that bound.",
        compute=lambda o: o.diverged.double().mean(1),
        shown=Shown.WHERE_ANY,
        digits=1,
        factor=100,
        not_negative=True,
    )
)
register(
    Metric(
        "outside_share",
        "outside",
        "%",
        note="Outside: windows whose z_e or z_a lies outside the range of the training windows', where nothing has "
        "tested the model; for augmented versions, p⁺ is inside.",
        compute=lambda o: None if o.outside is None else o.outside.double().mean(1),
        shown=Shown.WHERE_ANY,
        digits=1,
        factor=100,
        not_negative=True,
    )
)
register(
    Metric(
        "doubtful_share",
        "doubtful fits",
        "%",
        note="Doubtful fits: windows whose fit never left its start, has a positive parameter at zero, or does not "
        "tell a parameter: its 90 % interval is wider than half the range in which fits start.",
        compute=lambda o: None if o.doubtful is None else o.doubtful.double().mean(1),
        digits=1,
        factor=100,
        not_negative=True,
    )
)
COST = register(
    Metric(
        "estimate_ms",
        "estimate",
        "ms",
        note="Estimate: processor time in which one seed estimates the parameters and the start of one window, all "
        "windows at once, on one core; solving the equation follows, for a flow once for each of the draws that are "
        "forecast.",
        compute=lambda o: None if o.estimate_ms is None else np.full(len(o.errors), o.estimate_ms),
        shown=Shown.LAST,
        not_negative=True,
        of_job=True,
    )
)
RELATIVE_ERROR = register(
    Metric(
        "relative_error",
        "error",
        "%",
        compute=lambda o: _errors_of_parameters(o)[2],
        better="lower",
        shown=Shown.FIRST,
        digits=1,
        not_negative=True,
        samples=_relative_samples,
    )
)
RELATIVE_ERROR_OF = register(
    Metric(
        "relative_error_{of}",
        "{of} error",
        "%",
        compute=lambda o: _errors_of_parameters(o)[0],
        better="lower",
        digits=1,
        not_negative=True,
        samples=_relative_samples,
    )
)
RMSE_OF = register(
    Metric(
        "rmse_{of}", "{of} RMSE", None, compute=lambda o: _errors_of_parameters(o)[1], better="lower", not_negative=True
    )
)
register(
    Metric(
        "log_mse_true_z_e",
        "log-MSE with the true z_e, less that with the estimated",
        note="Where the true z_e makes forecasts worse, F_a makes up for a wrong one (of at most 64 samples).",
        compute=lambda o: None if o.with_truth is None else log_of_mean(o.with_truth[0]) - log_of_mean(o.with_truth[1]),
        digits=2,
        better="lower",
    )
)
register(
    Metric(
        "expert_share",
        "F_a in the expert's directions",
        "%",
        note="F_a in the expert's directions: how much of F_a another z_e would say as well, where the components of "
        "the state are independent.",
        compute=lambda o: o.expert_share,
        digits=1,
        factor=100,
        better="lower",
        not_negative=True,
    )
)
register(Metric("crps", "CRPS of forecasts", compute=_of_draws("crps"), better="lower", not_negative=True))
register(
    Metric(
        "energy_score",
        "energy score of forecasts",
        compute=_of_draws("energy_score"),
        better="lower",
        not_negative=True,
    )
)
register(
    Metric(
        "forecast_coverage_{of}",
        "forecasts in the {of} % band",
        "%",
        compute=_of_draws("forecast_coverage"),
        digits=1,
        not_negative=True,
    )
)
# Of a training, not of a set's forecasts.
register(Metric("wall_s", "training time", "s", digits=0, not_negative=True, of_job=True))
