"""The table of seeds: each one, and the median of their forecasts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_windows import SEEDS, curves, forecasts
from matplotlib.figure import Figure

from expertaug.evaluation.seeds import EMPTY, seeds

JOB = curves()


def with_median(fails: float = 1.0):
    """Of two seeds, of which the second's errors are so many times as large; the median's are the first's."""
    of = forecasts()
    sets = {}
    for name, each in of.sets.items():
        errors = np.stack([each.errors[0], fails * each.errors[0]])
        sets[name] = replace(each, errors=errors, median=each.errors[0])
    return replace(of, sets=sets)


def test_a_seed_that_fails_is_told_and_the_median_is_not_moved():
    made = seeds([with_median(fails=np.e**3)], JOB)
    shifted = made.numbers.query("set == 'test'").set_index("of")["log_mse"]
    assert shifted["median"] == pytest.approx(shifted["seed"].iloc[0])
    assert shifted["seed"].iloc[1] - shifted["seed"].iloc[0] == pytest.approx(3)
    assert shifted["mean"] == pytest.approx(shifted["median"] + 1.5)
    assert list(made.numbers.query("of == 'seed' and set == 'iid'")["seed"]) == SEEDS
    ((_, rows),) = [part for part in made.tables[0].parts if part[0] == JOB.of_set("test")]
    best, worst = (float(cell.replace("−", "-")) for cell in rows[0][2:4])
    assert f"{shifted['median']:.2f} [".replace("-", "−") in made.markdown() and "–" not in made.markdown()
    assert worst - best == pytest.approx(3, abs=0.011)
    assert isinstance(made.figure(), Figure)


def test_groups_of_seeds_each_have_a_median():
    first = with_median(2.0)
    second = replace(first, seeds=[2, 3])
    made = seeds([first, second], JOB).numbers.query("set == 'test'")
    assert len(made.query("of == 'seed'")) == 4 and len(made.query("of == 'median'")) == 1


@pytest.mark.parametrize("of", [forecasts(), with_median()], ids=["from before it was kept", "the same of all seeds"])
def test_versions_without_several_seeds_of_their_own_are_left_out(of):
    made = seeds([of], JOB)
    assert not len(made.numbers) and EMPTY in made.markdown() and isinstance(made.figure(), Figure)
