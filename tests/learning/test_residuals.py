"""Squared errors where the truth was measured, against NumPy."""

from __future__ import annotations

import numpy as np
import torch

from expertaug.learning.residuals import sample_mean, squared_errors, window_residual
from expertaug.systems.pendulum import DampedPendulum

SYSTEM = DampedPendulum()


def states(gaps=0.0):
    """Forecasts and truths (7, 2, 5, 2), of which a share was not measured."""
    generator = torch.Generator().manual_seed(0)
    forecast, truth, chance = (torch.rand(7, 2, 5, 2, generator=generator, dtype=torch.float64) for _ in range(3))
    return forecast, torch.where(chance < gaps, torch.nan, truth)


def test_each_dimension_counts_by_the_mean_over_the_times_at_which_it_was_measured():
    forecast, truth = states(gaps=0.3)
    truth[:, 0, 1] = torch.nan
    found = squared_errors(SYSTEM, forecast, truth)
    each = (forecast - truth).square().numpy()
    assert found[0, 1].isnan() and found.isnan().sum() == 1, "nothing of it was measured"
    known = ~found.isnan().numpy()
    np.testing.assert_allclose(found[known], np.nanmean(each[:, known], axis=0).sum(-1))


def test_the_misfit_of_a_window_is_that_of_its_points_after_the_first():
    forecast, truth = states()
    window = truth[:4].clone()
    window[0] += 100
    expected = (forecast[1:4] - truth[1:4]).square().sum(-1).mean(0)
    torch.testing.assert_close(window_residual(SYSTEM, forecast, window), expected)


def test_the_mean_over_samples_leaves_out_those_that_do_not_count():
    each = torch.tensor([[1.0, 2.0, torch.inf], [1.0, 2.0, 6.0]])
    good = torch.tensor([[True, True, False], [True, True, True]])
    assert sample_mean(each, good).tolist() == [1.5, 3.0] and sample_mean(each)[1] == 3
    assert sample_mean(each, torch.zeros_like(good)).tolist() == [0.0, 0.0]
