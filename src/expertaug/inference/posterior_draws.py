"""Draws from what an estimator says of each window, whoever it is."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.inference.flow import FlowEstimator
from expertaug.inference.least_squares import LeastSquares
from expertaug.learning.random_streams import RandomStreams
from expertaug.models.decoder import Decoder
from expertaug.models.posterior import Estimates, Gaussian, Predictor, constrain
from expertaug.systems import System

COUNT = 119  # so that intervals of 50 % and 90 % end at draws
DRAWS = 6  # of the keys of random numbers


def z_e_draws(found: Estimates, count: int = COUNT) -> Tensor | None:
    """Draws of z_e (S, B, K, P), in its units, evenly spread (Sobol); None where the estimator has a point alone.

    Arguments:
        found: of windows; a flow's have draws of their own, as many as it was asked for.
        count: K, for a Gaussian.
    """
    if found.draws is not None:
        return found.draws[0]
    if found.posterior is None or not isinstance(found.posterior.z_e, Gaussian):
        return None
    q = found.posterior.z_e
    sobol = torch.quasirandom.SobolEngine(q.loc.shape[-1], scramble=True, seed=0)
    normal = torch.special.ndtri(sobol.draw(count, dtype=torch.float64).clamp(1e-9, 1 - 1e-9)).to(q.loc)
    raw = q.loc.unsqueeze(-2) + q.log_std.exp().unsqueeze(-2) * normal
    return raw if q.parameters is None else constrain(raw, q.parameters)


@torch.no_grad()
def joint_draws(
    model: Predictor, found: Estimates, windows: Tensor, count: int, random: RandomStreams
) -> tuple[Tensor, Tensor, Tensor] | None:
    """Independent draws of (z_e, z_a, y0) for each window: of a flow, of Laplace's approximation of a fit, or of an
    encoder's Gaussian (whose first point is the observed one); None where the estimator has a point alone.

    Arguments:
        model: an estimator, whose estimates ``found`` are.
        windows: observed, (T1, S, B, *observed).
        count: K.
        random: whence they come.

    Returns:
        z_e (K, S, B, P), z_a (K, S, B, Q) and y0 (K, S, B, *state).
    """
    samples = windows.shape[2]
    if isinstance(model, FlowEstimator):
        normal = random.normal(count, samples, model.head.unknowns.count).transpose(0, 1)
        return model.draws(windows, normal.to(windows))
    if isinstance(model, LeastSquares):
        return model.fit.draws(found, model.fit.first(windows), random.normal(count, samples, sum(model.fit.sizes)))
    posterior = found.posterior
    if posterior is None or not any(isinstance(q, Gaussian) for q in (posterior.z_e, posterior.z_a)):
        return None

    def drawn(q: object, mean: Tensor) -> Tensor:
        if not isinstance(q, Gaussian):
            return mean.expand(count, *mean.shape)
        raw = q.loc + q.log_std.exp() * random.normal(count, *q.loc.shape[1:]).transpose(0, 1).to(q.loc)
        return raw if q.parameters is None else constrain(raw, q.parameters)

    assert found.z_e is not None and found.z_a is not None
    z_e, z_a = drawn(posterior.z_e, found.z_e), drawn(posterior.z_a, found.z_a)
    return z_e, z_a, found.y0.expand(count, *found.y0.shape)


class Drawn:
    """An estimator with a distribution but no draws of its own, as a :class:`~expertaug.inference.predictive.Sampler`.

    Arguments:
        model: a fit, or an encoder whose posterior is Gaussian.
        seeds: of the group: what is drawn depends on them alone.
        bound: (C,), how far a forecast's components may go.
    """

    def __init__(self, model: Predictor, seeds: Sequence[int], bound: Tensor | None) -> None:
        self.model, self.seeds, self.bound = model, list(seeds), bound

    @property
    def system(self) -> System:
        return self.model.system  # type: ignore[attr-defined]

    @property
    def decoder(self) -> Decoder:
        return self.model.decoder  # type: ignore[attr-defined]

    def sample(self, windows: Tensor, count: int, seed: int | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """As of a flow.

        Raises:
            InputError: the model estimates a point alone.
        """
        found = self.model.estimate(windows)  # type: ignore[attr-defined]
        drawn = joint_draws(
            self.model, found, windows, count, RandomStreams(self.seeds, 0 if seed is None else seed, DRAWS)
        )
        if drawn is None:
            remedy = "give one of expertaug.fit_posterior, or a refined one"
            raise InputError("model", "estimates a point and has no draws", remedy)
        return drawn
