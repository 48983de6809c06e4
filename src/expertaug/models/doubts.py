"""What is doubtful about a fit of a window: it never left its start, a parameter is at its bound, or cannot be told.

None of these is seen in the forecast of the observed window, nor in χ² alone.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from expertaug.models.card import ModelCard
from expertaug.models.posterior import Estimates
from expertaug.models.settings import TOLD
from expertaug.systems import System

HALF = 1.645  # standard deviations to either end of a 90 % interval
ZERO = 1e-3  # of a parameter's scale: a positive one as small is at its bound
STUCK = (
    "%d of %d fits never left their start and do not explain their windows: nothing there depends on the parameters, "
    "or the model runs away"
)
AT_BOUND = "%d of %d windows have %s at its bound, zero"
UNTOLD = "%d of %d windows do not tell %s: the 90 %% interval is wider than half the range in which fits start"
TOGETHER = "; each is told once the others are known: only a combination of them counts"
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class FitDoubts:
    """Of S seeds and N windows.

    Attributes:
        names: of the P expert parameters.
        stuck: whether a fit has never found a better point than its start, and does not explain its window, (S, N).
        at_bound: whether a positive parameter is next to zero, (S, N, P).
        untold: whether a parameter's 90 % interval is wider than half the range in which fits start, (S, N, P).
        alone: whether it would be told if all other coordinates of the fit were known, (S, N, P).
    """

    names: tuple[str, ...]
    stuck: Tensor
    at_bound: Tensor
    untold: Tensor
    alone: Tensor

    @property
    def any(self) -> Tensor:
        """Whether anything is doubtful about a window's fit, (S, N)."""
        return self.stuck | self.at_bound.any(-1) | self.untold.any(-1)

    def of_most(self, places: Sequence[int]) -> FitDoubts:
        """What holds for half of some of the seeds or more, with an axis of one seed."""
        fields = ("stuck", "at_bound", "untold", "alone")
        halves = {name: getattr(self, name)[list(places)].double().mean(0) >= 0.5 for name in fields}
        return replace(self, **{name: half.unsqueeze(0) for name, half in halves.items()})

    def reasons(self, window: int) -> list[str]:
        """Of one window, in words; what holds for half of the seeds or more."""
        reasons = ["the fit never left its start"] if _most(self.stuck[:, window]) else []
        for k, name in enumerate(self.names):
            if _most(self.at_bound[:, window, k]):
                reasons.append(f"{name} is at its bound, zero")
            elif _most(self.untold[:, window, k]):
                reasons.append(f"the window does not tell {name}")
        return reasons

    def warn(self) -> None:
        """A line for each kind of doubt, where it is one about a tenth of the windows or more."""
        count = self.stuck.shape[1]
        if (stuck := _most(self.stuck).sum().item()) * 10 >= count:
            logger.warning(STUCK, stuck, count)
        for k, name in enumerate(self.names):
            if (bound := _most(self.at_bound[..., k]).sum().item()) * 10 >= count:
                logger.warning(AT_BOUND, bound, count, name)
        untold = _most(self.untold)
        which = [k for k in range(len(self.names)) if untold[:, k].sum().item() * 10 >= count]
        if which:
            together = len(which) > 1 and bool(self.alone[..., which].double().mean() >= 0.5)
            names = " and ".join(self.names[k] for k in which)
            text = UNTOLD + (TOGETHER if together else "")
            logger.warning(text, untold[:, which].any(1).sum().item(), count, names)


def doubts_of(system: System, card: ModelCard, estimates: Estimates) -> FitDoubts | None:
    """What is doubtful about fits of windows; None of estimates that are no fits.

    Arguments:
        card: of the model, with how windows are fitted.
        estimates: (S, N, …), of :class:`expertaug.inference.least_squares.LeastSquares`.
    """
    if estimates.root is None or estimates.stuck is None or estimates.z_e is None or estimates.z_e_std is None:
        return None
    z_e, std = (value.detach().double().cpu() for value in (estimates.z_e, estimates.z_e_std))
    parameters = system.expert_parameters
    scale = torch.tensor([p.scale for p in parameters], dtype=torch.float64)
    positive = torch.tensor([p.positive for p in parameters], dtype=torch.bool)
    widths = _widths(card, system)
    untold = alone = torch.zeros_like(z_e, dtype=torch.bool)
    if widths is not None:
        untold = ~(2 * HALF * std <= TOLD * widths)
        alone = untold & (2 * HALF * _std_alone(estimates.root, z_e, system, card) <= TOLD * widths)
    names = tuple(p.name for p in parameters)
    return FitDoubts(names, estimates.stuck.cpu(), positive & (z_e < ZERO * scale), untold, alone)


def _widths(card: ModelCard, system: System) -> Tensor | None:
    """Of the ranges (P,) in which fits start; None where there are none."""
    ranges = None if card.refinement is None else card.refinement.prior
    if not isinstance(ranges, Mapping):
        return None
    ends = torch.tensor([tuple(ranges[p.name]) for p in system.expert_parameters], dtype=torch.float64)
    return ends[:, 1] - ends[:, 0]


def _std_alone(root: Tensor, z_e: Tensor, system: System, card: ModelCard) -> Tensor:
    """Each parameter's standard deviation if all other coordinates of the fit were known, (S, N, P)."""
    covariance = root.detach().double().cpu() @ root.detach().double().cpu().mT
    precision = torch.linalg.pinv(covariance, hermitian=True).diagonal(dim1=-2, dim2=-1)
    shared = {} if card.refinement is None else (card.refinement.shared or {})
    alone, place = torch.zeros_like(z_e), 0
    for k, parameter in enumerate(system.expert_parameters):
        if parameter.name not in shared:  # a coordinate: ln(z_e / scale) of a positive one, z_e / scale of another
            slope = z_e[..., k] if parameter.positive else torch.full_like(z_e[..., k], parameter.scale)
            alone[..., k] = slope.abs() / precision[..., place].clamp_min(1e-30).sqrt()
            place += 1
    return alone


def _most(which: Tensor) -> Tensor:
    """What holds for half of the seeds, the first axis, or more."""
    return which.double().mean(0) >= 0.5
