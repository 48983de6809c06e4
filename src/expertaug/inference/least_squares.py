"""Estimators by least squares on each window: with the expert alone, or refining what a trained model estimates."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.inference.latent import Latent
from expertaug.inference.window_fit import WindowFit
from expertaug.inference.window_problem import assumed_noise
from expertaug.models.decoder import Decoder
from expertaug.models.observation_noise import GivenNoise, is_some, noise_of
from expertaug.models.posterior import Estimates, Estimator, Predictor
from expertaug.models.settings import Refinement, RefinementSettings
from expertaug.models.store import StoredModel
from expertaug.settings import given_ranges
from expertaug.systems import System
from expertaug.systems.solvers.solver import Solver


class LeastSquares(Predictor, nn.Module):
    """Nonlinear least squares on each window, and the decoder's forecast from it.

    Arguments:
        decoder: what forecasts.
        fit: of windows, with the same decoder.
        first: whose estimates are a start of each fit: the result is then *refined*.
    """

    def __init__(self, decoder: Decoder, fit: WindowFit, first: Estimator | None = None) -> None:
        super().__init__()
        self.decoder, self.fit = decoder, fit
        self.__dict__["first"] = first  # no part of this module: its parameters are its own
        self.alone = first is None and not any(True for _ in decoder.parameters())

    @property
    def system(self) -> System:
        return self.decoder.system

    @torch.no_grad()
    def estimate(self, windows: Tensor) -> Estimates:
        """Observed windows (T1, S, B, *observed) → estimates, with χ² per degree of freedom and Laplace's posterior."""
        shared = windows[:, :1].expand_as(windows)
        if self.alone and torch.allclose(windows, shared, 0.0, 0.0, equal_nan=True):  # the same for every seed
            return self.fit(windows[:, :1]).expand(windows.shape[1])
        return self.fit(windows, None if self.first is None else self.first.estimate(windows))

    def forecast(
        self, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, solver: Solver, u: Tensor | None = None
    ) -> Tensor:
        """The decoder's: states (T, …, B, *state) at the times t (T,), from y0 (…, B, *state)."""
        return self.decoder.forecast(y0, z_e, z_a, t, solver, u)


def estimator_of(
    stored: StoredModel,
    settings: Mapping | RefinementSettings | None,
    noise: GivenNoise,
    prior: Mapping[str, tuple[float, float]] | None,
) -> LeastSquares:
    """Least squares with a stored model's decoder: from its own estimates too, where it has any.

    Arguments:
        stored: hybrid, a flow's, or a decoder without estimates of its own (kinds alternating and least_squares).
        settings: see :class:`RefinementSettings`.
        noise: standard deviation of the data's noise (:func:`expertaug.models.observation_noise.noise_of`).
        prior: range of each expert parameter in which starts lie; None: only the model's own estimates are starts.

    Raises:
        InputError: a model without a decoder.
    """
    options = RefinementSettings.from_mapping(settings)
    card = stored.card
    if card.kind == "mean":
        raise InputError("refinement", "a mean of the training set", "only models with an expert can be fitted")
    if card.kind == "hybrid" and card.latent is None:
        raise InputError("refinement", "the model file does not say where its z_a lie", "train it again")
    first = None if card.kind in ("alternating", "least_squares") else stored.model
    decoder: Decoder = stored.model if first is None else stored.model.decoder
    given = options.model_fields_set
    solver = options.solver if "solver" in given else card.training.solver
    known = noise_of(noise, decoder.system, card)
    free = options.free_start if "free_start" in given else is_some(known)
    fit = WindowFit(
        decoder,
        torch.tensor(card.t[: card.observed], dtype=torch.float64),
        options,
        assumed_noise(options, known, card.bound),
        bool(free),
        prior,
        Latent.of(card, options.latent),
        Solver(**dict(solver or {})),
        card.start,
    )
    return LeastSquares(decoder, fit, first)


def refined_by(stored: StoredModel, refinement: Refinement) -> LeastSquares:
    """As :func:`estimator_of`, as a refinement says."""
    prior = None if refinement.prior is None else given_ranges(refinement.prior)
    return estimator_of(stored, refinement.settings, refinement.noise, prior)


def refinement_of(stored: StoredModel, given: Mapping[str, object] | None) -> Refinement | None:
    """How a version's windows are fitted: as settings say, else as its model file does; None where they are not."""
    return stored.card.refinement if not given else Refinement.from_mapping(given)
