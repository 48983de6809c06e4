"""Does F_a stay valid when z_e moves?  The paper's assumption A1, checked on a trained model.

Augmentation simulates with an F_a that was learned where the training windows lie.  Two answers are given for each
window: how well the model explains it after least squares (χ², without any truth), and, for simulated data, how far
F_a is from the true interaction on the window's own states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.models.decoder import Decoder
from expertaug.systems.inputs import further

BINS = 8
TAKEN = 0.75  # of the windows of a bin must be explained for F_a to hold there
QUANTILE = 0.95  # of the training windows' χ²: what is above is not explained


@dataclass(frozen=True)
class Validity:
    """Where along one expert parameter F_a holds.

    Attributes:
        parameter: its name.
        edges: of the bins, (B + 1,), in its unit.
        explained: share of each bin's windows whose χ² is below ``limit``, (B,); NaN in an empty bin.
        chi2: median χ² per degree of freedom of each bin, (B,).
        limit: the 95 % quantile of the training windows' χ².
        trained: lowest and highest value of the training windows.
    """

    parameter: str
    edges: np.ndarray
    explained: np.ndarray
    chi2: np.ndarray
    limit: float
    trained: tuple[float, float]

    @property
    def holds(self) -> tuple[float, float] | None:
        """The range around the training range in which every bin is explained; None where not even that one is."""
        low, high = self.trained
        centres = 0.5 * (self.edges[1:] + self.edges[:-1])
        good = np.isnan(self.explained) | (self.explained >= TAKEN)
        inside = np.flatnonzero((centres >= low) & (centres <= high))
        if not len(inside) or not good[inside].all():
            return None
        first, last = inside[0], inside[-1]
        while first > 0 and good[first - 1]:
            first -= 1
        while last < len(good) - 1 and good[last + 1]:
            last += 1
        return float(self.edges[first]), float(self.edges[last + 1])

    @property
    def says(self) -> str:
        """One sentence."""
        where = f"F_a learned on {self.parameter} in [{self.trained[0]:.3g}, {self.trained[1]:.3g}]"
        found = self.holds
        if found is None:
            return f"{where} does not explain its own range"
        return f"{where} holds in [{found[0]:.3g}, {found[1]:.3g}] of the windows given"


def along(parameter: str, z_e: np.ndarray, chi2: np.ndarray, train_z_e: np.ndarray, train_chi2: np.ndarray) -> Validity:
    """Where along a parameter windows are explained as well as the training windows are.

    Arguments:
        z_e, chi2: of windows, (N,); χ² per degree of freedom after least squares.
        train_z_e, train_chi2: of training windows, (M,).

    Raises:
        InputError: shapes disagree, or a value is no number.
    """
    for name, one, other in (("chi2", z_e, chi2), ("train_chi2", train_z_e, train_chi2)):
        if one.shape != other.shape or one.ndim != 1 or not len(one):
            raise InputError(name, f"has shape {other.shape}", f"give a number for each of {one.shape} parameters")
        if np.isnan(one).any() or np.isnan(other).any():
            raise InputError(name, "has values that are no numbers", "leave these windows out")
    limit = float(np.quantile(train_chi2, QUANTILE))
    ends = min(z_e.min(), train_z_e.min()), max(z_e.max(), train_z_e.max())
    edges = np.linspace(*ends, BINS + 1)
    place = np.clip(np.searchsorted(edges, z_e, side="right") - 1, 0, BINS - 1)
    bins = [chi2[place == k] for k in range(BINS)]
    explained = np.array([np.mean(one <= limit) if len(one) else np.nan for one in bins])
    median = np.array([np.median(one) if len(one) else np.nan for one in bins])
    return Validity(parameter, edges, explained, median, limit, (float(train_z_e.min()), float(train_z_e.max())))


@torch.no_grad()
def error_of_interaction(
    decoder: Decoder,
    t: Sequence[float],
    y: Tensor,
    z_e: Tensor,
    z_a: Tensor,
    found_z_e: Tensor,
    found_z_a: Tensor,
    u: Tensor | None = None,
) -> Tensor:
    """‖F_a − truth‖ / ‖truth‖ along each window's own states: (S, N); simulated data alone know the truth.

    Arguments:
        decoder: stacked over S seeds, with F_a.
        t: times in s, (T,).
        y: states (T, N, *state).
        z_e, z_a: true parameters (N, P) and (N, Q).
        found_z_e, found_z_a: estimates (S, N, ·), of which F_a is a function.
        u: known inputs (T, N, U) of a system that has some.

    Raises:
        InputError: a decoder without F_a.
    """
    if decoder.interaction is None:
        raise InputError("model", "has no interaction model", "give a hybrid one")
    system, seeds = decoder.system, found_z_a.shape[0]
    context = decoder.interaction.context(found_z_a, found_z_e)
    wrong = torch.zeros(seeds, y.shape[1], dtype=torch.float64)
    size = torch.zeros(y.shape[1], dtype=torch.float64)
    known = [None] * len(y) if u is None else u
    for time, state, given in zip(t, y, known, strict=True):
        at, more = torch.as_tensor(time, dtype=y.dtype), further(system, state, z_e, given)
        true = system.truth(at, state, z_e, z_a, *more) - system.expert(at, state, z_e, *more)
        wide = None if given is None else given.expand(seeds, *given.shape)
        learned = decoder.interaction_rate(state.expand(seeds, *state.shape), context, at, wide)
        wrong += (learned - true).double().square().flatten(2).sum(-1)
        size += true.double().square().flatten(1).sum(-1)
    return (wrong / size).sqrt()
