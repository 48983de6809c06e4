"""Parameters that all windows share: one pendulum has one length, however many windows show it.

The windows' sum of squares is minimised over the shared parameters and each window's own ones together.  Given the
former, windows are independent, so that their own parameters are eliminated from the normal equations window by window
(a Schur complement); what is left is a system of the size of what is shared.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from expertaug import systems
from expertaug.errors import InputError
from expertaug.inference.least_squares import MEMORY, WindowFit, estimator_of
from expertaug.inference.levenberg_marquardt import DAMPING, LESS, MORE, TIGHTEST, linearised
from expertaug.learning.settings import UntrainedJob
from expertaug.learning.train import Calibration, describe_recipe, make_untrained
from expertaug.learning.training_data import set_files
from expertaug.models import store
from expertaug.models.settings import Constant, Refinement
from expertaug.models.store import StoredModel
from expertaug.settings import given_ranges
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows

logger = logging.getLogger(__name__)
STEPS = 60
TOLERANCE = 1e-9  # of the cost: the windows together are at their minimum
FEWEST_GROUPS = 8  # of windows whose residuals are independent, below which blocks of windows stand for groups
BLOCKS = 10


@dataclass(frozen=True)
class NormalEquations:
    """The problem in its linear approximation: of N windows with K coordinates each, M of them shared.

    Attributes:
        cost: sum of squares of each window, (N,).
        curvature: JᵀJ, (N, K, K).
        slope: Jᵀr, (N, K).
    """

    cost: Tensor
    curvature: Tensor
    slope: Tensor


def run_stage(data: Path, output: Path, settings: UntrainedJob, calibration: Path | None = None) -> None:
    """Stage: fit what all windows of ``data/train.npz`` share, and write the model whose file has these constants.

    Arguments:
        data: folder of the sets.
        output: model file.
        settings: of the job; its refinement says what is shared.
        calibration: JSON whose ``constants`` complete the system's settings.

    Raises:
        InputError: unusable data or settings.
    """
    described = describe_recipe(settings, None if calibration is None else Calibration.load(calibration))
    train, build = Trajectories.load(set_files(data)[0]), settings.build
    system = systems.load(described.system)
    stored = make_untrained(build.kind, system, train, settings, described, bool(build.truth))
    if settings.refinement is None or not settings.refinement.settings.shared:
        raise InputError("refinement.units", "nothing is shared", "say of a parameter that it is: NAME: shared")
    began = time.perf_counter()
    refinement = fit_shared(stored, settings.refinement, train)
    card = stored.card.but(refinement=refinement, wall_s=time.perf_counter() - began)
    store.save(output, stored.model, card)


def fit_shared(stored: StoredModel, refinement: Refinement, train: Trajectories) -> Refinement:
    """The refinement with constants for what its settings call shared, fitted to the training windows.

    Standard errors are those of clustered observations (Liang & Zeger 1986), by trajectory, or, of fewer than eight, by
    blocks of windows in their order: residuals of a model that is not quite right are correlated along a trajectory and
    over windows that overlap, and the curvature alone gives errors that are several times too small.

    Arguments:
        stored: the expert alone.
        refinement: with a prior, in which the fits of single windows start.
        train: windows of what shares the parameters, with their identities, where they have any.

    Raises:
        InputError: a name that is no expert parameter, or no prior.
    """
    names = [p.name for p in stored.model.system.expert_parameters]
    shared = refinement.settings.shared
    if wrong := sorted({*(refinement.settings.units or {})} - set(names)):
        raise InputError(f"units.{wrong[0]}", "is no expert parameter", f"known: {', '.join(names)}")
    if not shared:
        return refinement
    if refinement.prior is None:
        raise InputError("units", "given without a prior", "give a range of each parameter in which fits start")
    each = refinement.settings.model_copy(update={"units": {}})
    fit = estimator_of(stored, each, refinement.noise, given_ranges(refinement.prior)).fit
    windows = Windows.of(train).until(stored.card.observed).joined.double()
    places = [names.index(name) for name in shared]
    x, equations = _minimise(fit, windows, places)
    groups = groups_of(train)
    covariance = _covariance(equations, places, groups)
    values = fit.parts(x, fit.first(windows))[0][0, 0, places]
    std = covariance.diagonal().clamp_min(0).sqrt() * fit.expert.slope(x[0, 0, : len(names)])[places]
    constants = {
        name: Constant(value=float(value), std=float(error), groups=len(set(groups.tolist())))
        for name, value, error in zip(shared, values, std, strict=True)
    }
    return refinement.model_copy(update={"shared": constants})


def groups_of(data: Trajectories) -> np.ndarray:
    """Numbers (N,) of the groups of windows whose residuals are taken as independent: trajectories, or blocks."""
    count = len(data)
    if data.id is None:
        return np.arange(count)
    names = [str(name).rpartition("/")[0] for name in data.id]
    places = np.unique(names, return_inverse=True)[1]
    if len(set(names)) >= FEWEST_GROUPS:
        return places
    return np.minimum(np.arange(count) * BLOCKS // count, BLOCKS - 1) + BLOCKS * places


@torch.no_grad()
def _minimise(fit: WindowFit, windows: Tensor, places: Sequence[int]) -> tuple[Tensor, NormalEquations]:
    """Coordinates (1, N, K) at the minimum, the shared ones being equal, and the equations there."""
    x = fit.coordinates(fit(windows), fit.first(windows))
    x[..., places] = x[..., places].median(dim=1, keepdim=True).values
    now, damping, done = _equations(fit, windows, x), DAMPING, False
    for _ in range(STEPS):
        trial = x + _step(now, places, damping, fit.longest)
        new = _equations(fit, windows, trial)
        gain = float(now.cost.sum() - new.cost.sum())
        if gain > 0:
            x, now, damping = trial, new, damping * LESS
        else:
            damping *= MORE
        done = damping > TIGHTEST or 0 < gain <= TOLERANCE * float(now.cost.sum())
        if done:
            break
    if not done:
        logger.warning("shared parameters: the fit has not ended after %d steps; narrow the prior or share less", STEPS)
    return x, now


def _equations(fit: WindowFit, windows: Tensor, x: Tensor) -> NormalEquations:
    parts, size = [], max(1, MEMORY // (windows[:, :, :1].numel() * 8 * (x.shape[-1] + 1)))
    for first in range(0, x.shape[1], size):
        some = windows[:, :, first : first + size]

        def residuals(candidates: Tensor, columns: Tensor, some: Tensor = some) -> Tensor:
            return fit.residuals(candidates, some[:, :, columns])

        parts.append(linearised(residuals, x[:, first : first + size]))
    return NormalEquations(*(torch.cat([part[k][0] for part in parts]) for k in range(3)))


def _eliminated(
    equations: NormalEquations, places: Sequence[int], damping: float
) -> tuple[Tensor, Tensor, Tensor, Tensor, list[int]]:
    """What each window says of the shared coordinates once its own are eliminated: curvature (N, M, M) and slope
    (N, M); how its own follow, (N, K − M, M) and (N, K − M); and the places of its own."""
    own = [k for k in range(equations.slope.shape[1]) if k not in places]
    curvature, slope = equations.curvature, equations.slope
    inner = curvature[:, own][:, :, own]
    diagonal = inner.diagonal(dim1=1, dim2=2)
    floor = 1e-9 * diagonal.amax(-1, keepdim=True).clamp_min(1e-30) if own else diagonal
    inner = inner + torch.diag_embed(damping * diagonal + floor)
    across = curvature[:, own][:, :, places]
    follow = torch.linalg.solve(inner, across)
    rest = torch.linalg.solve(inner, slope[:, own].unsqueeze(-1)).squeeze(-1)
    reduced = curvature[:, places][:, :, places] - across.mT @ follow
    left = slope[:, places] - (across.mT @ rest.unsqueeze(-1)).squeeze(-1)
    return reduced, left, follow, rest, own


def _step(equations: NormalEquations, places: Sequence[int], damping: float, longest: Tensor) -> Tensor:
    """The damped step (1, N, K)."""
    reduced, left, follow, rest, own = _eliminated(equations, places, damping)
    total = reduced.sum(0)
    damped = total + torch.diag(damping * total.diagonal() + 1e-12 * total.diagonal().amax())
    limit = longest[list(places)]
    shared = -torch.linalg.solve(damped, left.sum(0)).clamp(-limit, limit)
    step = torch.zeros_like(equations.slope)
    step[:, places] = shared
    step[:, own] = -(rest + follow @ shared)
    return step.nan_to_num(0.0, 0.0, 0.0).clamp(-longest, longest).unsqueeze(0)


def _covariance(equations: NormalEquations, places: Sequence[int], groups: np.ndarray) -> Tensor:
    """Of the shared coordinates, (M, M), from how the groups' slopes scatter, as leaving each group out once would tell
    (Bell & McCaffrey 2002): errors are not too small where groups are few. Of one group by the curvature alone."""
    reduced, left, *_ = _eliminated(equations, places, 0.0)
    inverse = torch.linalg.pinv(reduced.sum(0))
    numbers = torch.from_numpy(np.unique(groups, return_inverse=True)[1])
    count, size = int(numbers.max()) + 1, len(places)
    if count == 1:
        return inverse
    slopes = torch.zeros(count, size, dtype=left.dtype).index_add_(0, numbers, left)
    curvatures = torch.zeros(count, size, size, dtype=left.dtype).index_add_(0, numbers, reduced)
    others = torch.eye(size, dtype=left.dtype) - curvatures @ inverse
    slopes = (torch.linalg.pinv(others) @ slopes.unsqueeze(-1)).squeeze(-1)
    return (count - 1) / count * inverse @ (slopes.mT @ slopes) @ inverse
