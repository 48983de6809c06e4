"""Draws of z_e from what an estimator says of each window, whoever it is."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.models.estimates import Estimates
from expertaug.models.posterior import Gaussian, constrain

COUNT = 119  # so that intervals of 50 % and 90 % end at draws


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
