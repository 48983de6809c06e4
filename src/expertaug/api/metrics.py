"""Metrics of arrays in memory, batch first; the formulas are those of the tables (expertaug.evaluation.metrics)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor

from expertaug.api.arguments import Array
from expertaug.errors import InputError
from expertaug.evaluation import metrics
from expertaug.systems import System

__all__ = ["log_mse", "parameter_errors"]


def log_mse(system: System, prediction: Array, truth: Array, convention: str = "sum") -> float | np.ndarray:
    """Natural log of the mean, over samples and times, of the squared error of the observed quantities.

    Arguments:
        prediction: states (N, T, *state), or (S, N, T, *state) of S seeds.
        truth: states (N, T, *state).
        convention: sum: over the observed dimensions (the paper's tables); dim: divided by their number.

    Returns:
        a number, or (S,).

    Raises:
        InputError: the shapes disagree, or an unknown convention.
    """
    if convention not in ("sum", "dim"):
        raise InputError("convention", repr(convention), "sum or dim")
    y, true = _plain(prediction), _plain(truth)
    group = y.dim() == true.dim() + 1
    y = y if group else y.unsqueeze(0)
    if true.dim() != 2 + len(system.state_shape) or y.shape[1:] != true.shape:
        shapes = f"prediction {tuple(np.shape(prediction))}, truth {tuple(true.shape)}"
        raise InputError("log_mse", shapes, "give (N, T, *state) both, the prediction also (S, N, T, *state)")
    scores = metrics.log_mse(system, y.movedim(2, 0), true.unsqueeze(0).movedim(2, 0))[f"log_mse_{convention}"]
    return scores.numpy() if group else float(scores[0])


def parameter_errors(system: System, estimate: Mapping[str, Array], truth: Array) -> dict[str, float | np.ndarray]:
    """Relative error in % and root mean square error in its unit, of each expert parameter and of all.

    Arguments:
        estimate: by name, (N,) or (S, N), as forecasts give it.
        truth: z_e (N, P) of the same samples.

    Returns:
        name → a number, or (S,).

    Raises:
        InputError: a parameter is missing, or the shapes disagree.
    """
    names = [p.name for p in system.expert_parameters]
    if sorted(estimate) != sorted(names):
        raise InputError("estimate", f"of {', '.join(estimate) or 'nothing'}", f"give {', '.join(names)}")
    z_e, true = torch.stack([_plain(estimate[name]) for name in names], dim=-1), _plain(truth)
    group = z_e.dim() == 3
    z_e = z_e if group else z_e.unsqueeze(0)
    if z_e.shape[1:] != true.shape:
        raise InputError("parameter_errors", f"{tuple(z_e.shape[1:])} and {tuple(true.shape)}", "give (N, P) both")
    errors = metrics.parameter_errors(system, z_e, true.unsqueeze(0))
    return {k: v.numpy() if group else float(v[0]) for k, v in errors.items()}


def _plain(value: Array) -> Tensor:
    return value.detach().cpu() if isinstance(value, Tensor) else torch.from_numpy(np.asarray(value))
