"""Scores of forecasts: the bands of a right posterior hold."""

from __future__ import annotations

import numpy as np
import torch
from fitted_pendulum import NOISE, OBSERVED, T

from expertaug.evaluation.score import kept_of, score
from expertaug.evaluation.settings import Scoring
from expertaug.systems.settings import SolverSettings

SCORING = Scoring(draws=39, drawn_samples=60, solver=SolverSettings(method="rk4"))


def test_bands_of_laplaces_approximation_hold(fitted):
    stored, data = fitted
    found = score(stored, data, SCORING, "y0", torch.device("cpu"), keep=3, noise=NOISE)
    assert found.drawn.crps.shape == (2, 60) and found.band.shape == (2, 2, 3, len(T) - OBSERVED, 2)
    assert 84 < float(found.values["forecast_coverage_90"][0]) < 95
    assert 42 < float(found.values["forecast_coverage_50"][0]) < 58
    assert (found.band[0] < found.band[1]).all()
    # Noise alone has a CRPS of .23 standard deviations and half of √π for the vectors of two.
    assert 0.2 * NOISE < float(found.values["crps"][0]) < 0.6 * NOISE
    assert float(found.values["energy_score"][0]) > float(found.values["crps"][0])
    sure = score(stored, data, SCORING, "y0", torch.device("cpu"))
    assert float(sure.values["forecast_coverage_90"][0]) < 75, "draws without the data's noise are too sure"
    again = score(stored, data, SCORING, "y0", torch.device("cpu"), keep=3, noise=NOISE)
    assert np.array_equal(again.drawn.crps, found.drawn.crps) and torch.equal(again.band, found.band)
    assert "crps" not in score(stored, data, SCORING.without_draws, "y0", torch.device("cpu")).values


def test_kept_samples_are_kept_once():
    assert [kept_of(count, 3).tolist() for count in (1, 2, 3, 4, 9)] == [[0], [0, 1], [0, 1, 2], [0, 1, 2], [2, 4, 6]]
    assert kept_of(5, 0).tolist() == []
