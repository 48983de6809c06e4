"""The numbers that come first."""

from __future__ import annotations

from dataclasses import replace

from fake_runs import mean_of

from expertaug.evaluation.report import headline
from expertaug.evaluation.settings import ReportExperiment
from expertaug.evaluation.summary import TabledMean


def long_table(**validation: float) -> list[TabledMean]:
    """A long table: the log-MSE of versions on the validation set; on the test set the order is reversed."""
    signs = (("validation", 1), ("test", -1))
    return [mean_of(method, name, sign * score) for method, score in validation.items() for name, sign in signs]


def test_the_validation_set_alone_chooses_what_is_shown_first():
    scores = {"truth": -9.0, "known": -8.0, "least_squares": -1.0, "a": -3.0, "a=": -2.0, "a+": -4.0, "b+": 0.0}
    long = long_table(**scores, **{"a+~refined": -5.0})
    told = {"floors": ["truth"], "known_form": ["known"], "least_squares": ["least_squares"]}
    settings = ReportExperiment(name="swing", labels=[], **told)
    rows = dict(headline.choose_rows(long, settings))
    assert rows == {
        "a+~refined": "best by validation",
        "a+": "best + by validation",
        "a=": "its control",
        "a": "its base",
        "least_squares": "least squares",
        "truth": "floor",
    }
    other = [one if one.set == "validation" else replace(one, mean=0.0) for one in long]
    assert dict(headline.choose_rows(other, settings)) == rows
    refined = ("a+~refined", "validation")
    failed = [replace(one, n=1) if (one.method, one.set) == refined else one for one in long]
    assert headline.choose_rows(failed, settings)[0] == ("a+", "best by validation, best + by validation")
