"""What studies of single windows have of the forecasts of all groups of seeds."""

from __future__ import annotations

from fake_windows import N

from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.windows import windows_of


def test_seeds_of_all_groups_come_together(files):
    found = windows_of(map(Forecasts.load, files))
    assert list(found) == ["a", "a+~flow"] and found["a"].seeds == [0, 1]
    assert found["a"].sets["test"].errors.shape == (2, N) and found["a"].sets["test"].drawn is None
    assert found["a+~flow"].sets["iid"].drawn.ranks.shape == (2, N, 1)
