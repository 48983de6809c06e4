"""Whether F_a does the expert's work: forecasts with the true z_e, and how much of F_a another z_e would say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from expertaug.evaluation.forecasting import Drawing, Forecast
from expertaug.learning.divergence import BoundedSolver, clamp_to_bound, solve_with_sample_fallback
from expertaug.learning.expert_share import expert_share
from expertaug.learning.residuals import squared_errors
from expertaug.models.posterior import Estimates, Predictor
from expertaug.windows import Windows

PROBED, FIELDS = 64, 16  # samples of a set, evenly spread; of fields, each of which has a thousand points


class ExpertProbe:
    """Of a model with an expert and F_a, on some samples of a set.

    Arguments:
        model: whose forecasts they are.
        drawing: how forecasts are made.
        count: samples of the set.
    """

    def __init__(self, model: Predictor, drawing: Drawing, count: int) -> None:
        self.model, self.drawing = model, drawing
        decoder = getattr(model, "decoder", None)
        is_hybrid = model.knows_z_e and decoder.expert and decoder.interaction is not None
        self.decoder = decoder if is_hybrid and decoder.system.expert_parameters else None
        few = FIELDS if is_hybrid and len(decoder.system.state_shape) > 1 else PROBED
        self.places = np.linspace(0, count - 1, min(few, count)).astype(int)
        self.states: list[Tensor] = []
        self.windows: list[Windows] = []
        self.estimates: list[Estimates] = []
        self.worse: list[Tensor] = []  # squared errors with the true z_e and with the estimated, (2, S, K)

    def add(self, made: Forecast, windows: Windows, truth: np.ndarray, bound: Tensor | None, first: int) -> None:
        """Of further samples.

        Arguments:
            made: their forecasts.
            windows: y (T, S, B, *state), and all known inputs.
            truth: their true z_e, (B, P); NaN where nobody knows them.
            bound: (C,) or (B, C), how far forecasts may go.
            first: the place of the first of them in the set.
        """
        here = self.places[(self.places >= first) & (self.places < first + len(truth))] - first
        if self.decoder is None or made.found.z_e is None or made.found.z_a is None or not len(here):
            return
        some = torch.from_numpy(here).to(windows.y.device)
        estimates, part = replace(made.found.part(some), posterior=None, draws=None, root=None), windows.samples(some)
        self.states.append(made.states[:, :, some])
        self.windows.append(part)
        self.estimates.append(estimates)
        z_e = torch.from_numpy(truth[here]).to(estimates.z_e)
        if z_e.isnan().any() or self.drawing.start != "y0":
            return
        limit = bound if bound is None or bound.dim() == 1 else bound[some]
        with_true_z_e, t, decoder = replace(estimates, z_e=z_e.expand_as(estimates.z_e)), self.drawing.t, self.decoder

        def solved(which: slice, solver: BoundedSolver) -> Tensor:
            of, u = with_true_z_e.part(which), None if part.u is None else part.u[:, :, which]
            return decoder.forecast(of.y0, of.z_e, of.z_a, t, solver, u)

        states, _ = solve_with_sample_fallback(solved, len(here), self.drawing.solver, limit)
        begin, system = self.drawing.begin, self.decoder.system
        each = (clamp_to_bound(states, limit), made.states[:, :, some])
        self.worse.append(torch.stack([squared_errors(system, y[begin:], part.y[begin:]).cpu() for y in each]))

    def joined(self) -> tuple[Tensor | None, Tensor | None]:
        """The squared errors with the true and with the estimated z_e, (2, S, K), where z_e is known; and the share of
        F_a in the expert's directions, (S,); None of a model without both."""
        if self.decoder is None or not self.states:
            return None, None
        states, part, estimates = (
            torch.cat(self.states, dim=2),
            Windows.cat(self.windows),
            Estimates.joined(self.estimates),
        )
        share = expert_share(self.decoder, states, estimates.z_e, estimates.z_a, self.drawing.t, part.u)
        return torch.cat(self.worse, dim=2) if self.worse else None, share
