"""Sets of long chunks of tables: how far forecasts reach."""

from __future__ import annotations

import numpy as np
import pytest
from swings import GIVEN, NAMES, STEP, settings, trials

import expertaug as ea
from expertaug.errors import InputError
from expertaug.measurements.cut import measure
from expertaug.measurements.horizons import long_set
from expertaug.measurements.settings import SplitSettings

SPLIT = {"by": "time", "train_share": 0.4, "validation_share": 0.3, "test_share": 0.3}


def test_in_python_they_are_further_sets_of_the_same_points(tmp_path):
    shared = {k: v for k, v in GIVEN.items() if k != "columns"} | {"split": SPLIT, "columns": GIVEN["columns"]}
    path = str(trials(tmp_path))
    sets = ea.split_measurements(path, ea.DampedPendulum(), **shared, horizons_s=[2.0])
    assert list(sets) == ["train", "validation", "test", "validation_2s", "test_2s"]
    long, short = sets["test_2s"], sets["test"]
    assert long.t[-1] == 2.0 and len(long.t) == 41 and len(long) >= 1
    starts = {name: k for k, name in enumerate(short.id)}
    assert any(name in starts for name in long.id)
    for name, y in zip(long.id, long.y, strict=True):
        if name in starts:
            np.testing.assert_array_equal(y[: len(short.t)], short.y[starts[name]])
    first = [STEP * (int(name.rpartition("/")[2]) - 2) % 10 for name in long.id]
    assert min(first) >= 7 - 1e-9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"horizons_s": [0.9]}, r"horizons_s: found 0.9; chunks end at 0.95 s already"),
        ({"horizons_s": [4.0]}, r"no test chunk of 4 s: the longest stretch of its points lasts 3 s; give longer"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path, change, message):
    data = measure(settings(trials(tmp_path), split=SplitSettings(**SPLIT), **change), NAMES)
    with pytest.raises(InputError, match=message):
        long_set(data, f"test_{'900ms' if change['horizons_s'] == [0.9] else '4s'}")
