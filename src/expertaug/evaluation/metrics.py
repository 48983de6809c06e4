"""Pure functions of truth and forecast."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.learning.misfit import squared_errors
from expertaug.systems import System

__all__ = ["log_after", "log_mse", "log_of", "log_of_median", "parameter_errors", "squared_errors"]


def log_mse(system: System, prediction: Tensor, truth: Tensor) -> dict[str, Tensor]:
    """Natural log of the mean, over samples and times, of the squared error, in both conventions.

    ``log_mse_sum`` sums the squared error over the observed dimensions (the paper's tables), ``log_mse_dim`` divides
    the sum by :attr:`System.error_dims` first.

    Arguments:
        prediction, truth: states (T, S, N, *state).

    Returns:
        name → (S,).
    """
    return log_of(system, squared_errors(system, prediction, truth))


def log_of(system: System, errors: Tensor) -> dict[str, Tensor]:
    """The log-MSE in both conventions from :func:`squared_errors` (S, N)."""
    return _conventions("log_mse", errors.mean(1).log(), system)


def log_of_median(system: System, errors: Tensor) -> dict[str, Tensor]:
    """The log of the median over samples instead of the mean: ``log_mse_median``, which sums over the observed
    dimensions, and ``log_mse_median_dim``; one runaway hardly moves it."""
    found = _conventions("log_mse_median", torch.quantile(errors, 0.5, dim=1).log(), system)
    return {name.removesuffix("_sum"): value for name, value in found.items()}


def log_after(system: System, errors: Tensor) -> dict[str, Tensor]:
    """``log_mse_after_sum`` and ``log_mse_after_dim``, where errors are those after the observed window alone."""
    return _conventions("log_mse_after", errors.mean(1).log(), system)


def _conventions(name: str, summed: Tensor, system: System) -> dict[str, Tensor]:
    return {f"{name}_sum": summed, f"{name}_dim": summed - torch.log(torch.tensor(float(system.error_dims)))}


def parameter_errors(system: System, estimate: Tensor, truth: Tensor) -> dict[str, Tensor]:
    """Errors of the expert parameters.

    ``relative_error`` is the paper's: the mean over samples and parameters of |z − ẑ| / |z|, in %; it is dominated by
    samples with z near 0 where a parameter can vanish, so ``rmse_<name>`` stands beside it, in the parameter's unit.

    Arguments:
        estimate, truth: (S, N, P); a truth of NaN is not known and does not count.

    Returns:
        name → (S,); nothing of a parameter that no sample knows.
    """
    if torch.isnan(truth).any():
        return _errors_where_known(system, estimate, truth)
    relative = 100 * ((estimate - truth) / truth).abs().double().mean(1)
    squared = (estimate - truth).double().square().mean(1).sqrt()
    names = [p.name for p in system.expert_parameters]
    return (
        {"relative_error": relative.mean(1)}
        | {f"relative_error_{n}": relative[:, i] for i, n in enumerate(names)}
        | {f"rmse_{n}": squared[:, i] for i, n in enumerate(names)}
    )


def _errors_where_known(system: System, estimate: Tensor, truth: Tensor) -> dict[str, Tensor]:
    """:func:`parameter_errors` of the samples and parameters whose truth is known."""
    relative, rmse = {}, {}
    for k, parameter in enumerate(system.expert_parameters):
        known = ~torch.isnan(truth[0, :, k])
        if known.any():
            difference = (estimate[:, known, k] - truth[:, known, k]).double()
            relative[f"relative_error_{parameter.name}"] = 100 * (difference / truth[:, known, k]).abs().mean(1)
            rmse[f"rmse_{parameter.name}"] = difference.square().mean(1).sqrt()
    if not relative:
        return {}
    return {"relative_error": torch.stack(list(relative.values())).mean(0)} | relative | rmse
