"""What each kind of estimator says that it can do."""

from __future__ import annotations

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
