"""How badly a model explains observed windows: what needs no truth, and tells which forecasts to distrust."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

from expertaug.errors import SolveError
from expertaug.learning.bound import FALLBACK, Stopping, bounded, stored_bound
from expertaug.models.prediction import Predictor
from expertaug.models.store import StoredModel
from expertaug.systems import System
from expertaug.systems.solver import Solver

MOST = 500  # validation windows whose misfits a model file keeps, evenly spread
PART = 256  # windows at a time


def squared_errors(system: System, prediction: Tensor, truth: Tensor) -> Tensor:
    """Squared error of every sample, summed over the observed dimensions and averaged over time: (S, N), float64.

    Arguments:
        prediction, truth: states (T, S, N, *state).
    """
    error = (system.observe(prediction) - system.observe(truth)).double().square()
    return error.flatten(3).sum(-1).mean(0)


def misfit_of(system: System, states: Tensor, windows: Tensor) -> Tensor:
    """The misfit (S, N) of forecasts (T, S, N, *state) of windows (T1, S, N, *state): their squared error over the
    observed points after the first."""
    return squared_errors(system, states[1 : len(windows)], windows[1:])


@torch.no_grad()
def misfits(stored: StoredModel, windows: Tensor) -> Tensor:
    """The misfit (S, N) of windows (T1, 1, N, *state) by a model's own estimates."""
    model: Predictor = stored.model
    t = torch.tensor(stored.description["t"][: len(windows)], dtype=torch.float32, device=windows.device)
    bound, parts = stored_bound(stored.description, windows.device), []
    for part in windows.split(PART, dim=2):
        y = part.expand(-1, len(stored.seeds), *part.shape[2:])
        found = model.estimate(y)  # type: ignore[attr-defined]

        def predicted(solver: Solver, found: object = found, y: Tensor = y) -> Tensor:
            stopping = solver if bound is None else Stopping(solver, bound)
            return model.predicted(found, y, t, stopping)  # type: ignore[arg-type]

        try:
            states = predicted(stored.solver)
        except SolveError:
            states = predicted(FALLBACK)
        parts.append(misfit_of(model.system, bounded(states, bound), y))  # type: ignore[attr-defined]
    return torch.cat(parts, dim=1)


def recorded(stored: StoredModel, windows: Tensor) -> Mapping[str, list[list[float]]]:
    """What a model file says of validation windows (T1, 1, N, *state): their misfits, a list a seed."""
    index = torch.linspace(0, windows.shape[2] - 1, min(MOST, windows.shape[2])).long()
    found = misfits(stored, windows[:, :, index.to(windows.device)]).nan_to_num(1e30, 1e30)
    return {"validation": [[float(f"{value:.6g}") for value in seed] for seed in found.tolist()]}
