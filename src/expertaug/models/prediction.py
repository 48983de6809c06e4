"""From an observed window to a forecast: estimates first, then the decoder's forecast from them."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.models.estimates import Estimates
from expertaug.systems import System
from expertaug.systems.inputs import states_of
from expertaug.systems.solvers.solver import Solver


class Predictor:
    """What has ``estimate`` (an :class:`~expertaug.models.estimates.Estimator`) and ``forecast`` (a decoder's)."""

    system: System

    @property
    def knows_z_e(self) -> bool:
        """Whether an estimate of z_e is one of the expert's parameters, which can be compared with their truth: as the
        decoder says, where there is one."""
        decoder = getattr(self, "decoder", None)
        return decoder is not None and decoder.knows_z_e

    def predicted(
        self,
        found: Estimates,
        observed: Tensor,
        t: Tensor,
        solver: Solver,
        start: str = "y0",
        u: Tensor | None = None,
    ) -> Tensor:
        """The forecast that follows from estimates.

        Arguments:
            found: of the observed windows.
            observed: (T1, …, B, *observed), known inputs as further components of the state.
            t: (T,) in s, T ≥ T1.
            start: y0, or y_t1: integrate onwards from the last observed point and return the observation before it.
            u: known inputs (T, …, B, U) at all times; None for a system without.

        Returns:
            states (T, …, B, *state).
        """
        if start == "y0" or found.z_e is None or torch.isnan(observed).any():  # what was not measured has no rates
            return self.forecast(found.y0, found.z_e, found.z_a, t, solver, u)  # type: ignore[attr-defined]
        observed, last = states_of(self.system, observed), len(observed) - 1
        later = None if u is None else u[last:]
        onwards = self.forecast(observed[last], found.z_e, found.z_a, t[last:], solver, later)  # type: ignore[attr-defined]
        return torch.cat((observed[:last], onwards))

    def predict(
        self, observed: Tensor, t: Tensor, solver: Solver, start: str = "y0", u: Tensor | None = None
    ) -> tuple[Tensor, Tensor | None]:
        """The forecast of the estimates from windows, and the estimate of z_e (…, B, P) where :attr:`knows_z_e`; as
        :meth:`predicted`."""
        found = self.estimate(observed)  # type: ignore[attr-defined]
        return self.predicted(found, observed, t, solver, start, u), found.z_e if self.knows_z_e else None
