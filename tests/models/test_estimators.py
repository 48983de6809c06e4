"""What each kind of estimator says that it can do."""

from __future__ import annotations

import numpy as np
import pytest

import expertaug as ea
from expertaug.inference.flow import Flow
from expertaug.models.estimators import ESTIMATORS

HYBRID = ["hybrid", "hybrid_shared"]
CLASSICAL = ["least_squares", "least_squares_shared"]
ALTERNATING = ["alternating", "alternating_shared"]


def test_what_each_kind_can_do():
    of = {name: kind for name, kind in ESTIMATORS.items() if name != Flow.name}
    assert [name for name, kind in of.items() if kind.trains()] == [*HYBRID, *ALTERNATING]
    assert [name for name, kind in of.items() if kind.has_objective] == HYBRID
    assert [name for name, kind in of.items() if kind.fits_windows] == [*ALTERNATING, *CLASSICAL]
    assert [name for name, kind in of.items() if kind.is_classical()] == CLASSICAL
    assert [name for name, kind in of.items() if kind.shares] == [HYBRID[1], ALTERNATING[1], CLASSICAL[1]]
    assert [name for name, kind in of.items() if not kind.has_expert] == ["mean"]


def test_the_mean_lies_on_straight_lines_over_gaps():
    """Signals that were measured at times of their own are averaged as signals, not as what one of them was alone."""
    t = np.arange(5) * 0.5
    y = np.stack((np.stack((t, np.ones(5)), axis=1), np.stack((3 * t, np.ones(5)), axis=1)))
    mask = np.zeros(y.shape, dtype=bool)
    mask[0, [0, 2, 4], 0] = mask[1, [0, 1, 4], 0] = True
    seen = np.where(mask, y, 0.0)
    sets = ea.Trajectories(t, seen, np.zeros((2, 1)), mask=mask)
    model, _ = ESTIMATORS["mean"].fit(ea.DampedPendulum(), sets, None)
    assert model.mean[:, 0].tolist() == pytest.approx((2 * t).tolist())
    assert model.mean[:, 1].tolist() == [0.0] * 5, "nobody measured it"
    mask[1, :, 0] = False
    model, _ = ESTIMATORS["mean"].fit(ea.DampedPendulum(), ea.Trajectories(t, seen, np.zeros((2, 1)), mask=mask), None)
    assert model.mean[:, 0].tolist() == pytest.approx(t.tolist()), "of those that were measured"
