"""What an estimator makes of observed windows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from torch import Tensor

from expertaug.models.posterior import Posterior


@dataclass(frozen=True)
class Estimates:
    """Where a forecast starts and with which parameters.

    Attributes:
        y0: the known first point, (…, B, *state).
        z_e: expert parameters (…, B, P), in their units; None where nothing is estimated.
        z_a: latent of the interaction model, (…, B, Q); None where nothing is estimated.
        posterior: the distribution that z_e and z_a are the means of, where the estimator has one.
        chi2: how well they fit each window, (…, B), where the estimator has compared them with it.
    """

    y0: Tensor
    z_e: Tensor | None
    z_a: Tensor | None
    posterior: Posterior | None = None
    chi2: Tensor | None = None


class Estimator(Protocol):
    """Anything that reads (y0, z_e, z_a) off observed windows: an encoder, least squares, a flow."""

    def estimate(self, windows: Tensor) -> Estimates:
        """Observed windows (T1, …, B, *state) → estimates."""
        ...
