"""Settings of evaluations: what follows from them, and what is refused in one line."""

from __future__ import annotations

import pytest

from expertaug.errors import InputError
from expertaug.evaluation.settings import ForecastScoring, LabelledReading, ReportJob, Scoring, StudyJob, TabulateJob


def test_what_is_said_of_forecasts_is_said_of_their_scoring_which_draws_none():
    found = Scoring.of_forecasts(ForecastScoring(max_samples=7))
    assert (found.draws, found.max_samples, found.from_s) == (0, 7, None) and "from_s" not in found.model_fields_set
    scoring = Scoring(draws=39, samples=5)
    assert (scoring.without_draws.draws, scoring.without_draws.samples, scoring.draws) == (0, 5, 39)


def test_a_version_is_printed_as_its_label_and_one_without_as_its_name():
    reading = LabelledReading.of(labels=[["a", "A"], ["a+", "A, augmented"]], convention="dim")
    assert [reading.printed(name) for name in ("a+", "b")] == ["A, augmented", "b"]
    assert list(reading.label_of) == ["a", "a+"] and "averaged" in reading.convention_text


@pytest.mark.parametrize(
    ("kind", "given", "says"),
    [
        (StudyJob, {"labels": [], "study": "horizon"}, "study: found 'horizon'; did you mean 'horizons'"),
        (TabulateJob, {"labels": [], "convention": "mean"}, "convention: found 'mean'"),
        (TabulateJob, {"labels": [["a"]]}, r"labels\[0\]"),
        (Scoring, {"draws": 2000}, r"evaluation\.draws: found 2000"),
        (
            ReportJob,
            {"shown": [], "rules": [], "experiments": [], "files": [], "seeds": [0], "device": "cpu"},
            "preset",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(kind, given, says):
    with pytest.raises(InputError, match=says) as caught:
        kind.of(**given)
    assert "\n" not in str(caught.value)
