"""The squared error that is to be expected of each forecast, from its window alone: a score of alarms."""

from __future__ import annotations

import torch
from torch import Tensor

from expertaug.evaluation.forecast_scores import BYTES, Drawing
from expertaug.evaluation.metrics import squared_errors
from expertaug.evaluation.runaways import Forecast, forecast
from expertaug.evaluation.samples import EXPECTED, MOVED
from expertaug.learning.noise import Noise
from expertaug.models.hybrid import HybridNet
from expertaug.models.prediction import Predictor

KEY = 7  # of random numbers


class ExpectedError:
    """What a version expects of its own forecasts, and, of refined ones, what they expect of the encoder's.

    The first is the mean squared distance of forecasts from draws to the forecast, where a version has a distribution;
    the second the squared distance between the forecasts before and after refinement.

    Arguments:
        model: whose forecasts they are.
        drawing: how forecasts are drawn, and how many of each window; a count of 0 leaves the first out.
    """

    def __init__(self, model: Predictor, drawing: Drawing) -> None:
        self.model, self.drawing = model, drawing
        self.random = Noise(drawing.seeds, KEY, device=drawing.t.device)
        self.found: dict[str, list[Tensor]] = {}

    def add(self, made: Forecast, y: Tensor, windows: Tensor, bound: Tensor | None, u: Tensor | None) -> None:
        """Of further windows.

        Arguments:
            made: their forecasts.
            y: (T, S, B, *observed), of which the observed points are used, and all known inputs.
            windows: observed, (T1, S, B, *observed).
            bound: (C,) or (B, C), how far forecasts may go.
            u: known inputs (T, S, B, U); None for a system without.
        """
        drawing, begin = self.drawing, self.drawing.begin
        first = getattr(self.model, "first", None)
        if isinstance(first, HybridNet):
            before = forecast(first, windows, drawing.t, drawing.solver, drawing.start, bound, u)
            self._keep(MOVED, squared_errors(self.model.system, before.states[begin:], made.states[begin:]))
        if drawing.count and made.found.z_e is not None:
            self._add_own(made, y, bound)

    def _add_own(self, made: Forecast, y: Tensor, bound: Tensor | None) -> None:
        drawing = self.drawing
        size = max(BYTES // (drawing.count * y[:, 0, 0].numel() * y.element_size()), 1)
        for k in range(0, y.shape[2], size):
            part = slice(k, k + size)
            limit = bound if bound is None or bound.dim() == 1 else bound[part]
            drawn = drawing.states(self.model, made.found.part(part), y[:, :, part], limit, self.random)
            if drawn is None:
                return
            states = made.states[drawing.begin :, :, part]
            self._keep(EXPECTED, torch.stack([squared_errors(self.model.system, one, states) for one in drawn]).mean(0))

    def _keep(self, name: str, values: Tensor) -> None:
        self.found.setdefault(name, []).append(values.cpu())

    def joined(self) -> dict[str, Tensor]:
        """By the name of the array, (S, N)."""
        return {name: torch.cat(parts, dim=1) for name, parts in self.found.items()}
