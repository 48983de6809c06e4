"""The study of alarms, on made-up forecasts of which is known which ones fail."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from fake_windows import N, asked, curves, fake

from expertaug.errors import InputError
from expertaug.evaluation.alarms import run_stage as alarm
from expertaug.evaluation.distance import run_stage as distance


def test_an_alarm_that_knows_is_told_from_one_that_does_not(files, tmp_path):
    outputs = [tmp_path / f"alarm.{end}" for end in ("csv", "md", "tex", "png")]
    alarm(files, outputs, asked())
    table = pd.read_csv(outputs[0]).set_index(["method", "set", "score", "seed"])
    test = table.loc["a", "test", "misfit", 0]
    assert test["auroc"] > 0.97 and test["caught"] > 0.9 and 0.02 < test["false_alarms"] < 0.1
    assert 0.05 < test["failing"] < 0.15  # a fifth of the test set, pooled with as many IID windows
    assert abs(table.loc["a", "test", "spread", 0]["auroc"] - 0.5) < 0.1  # noise that knows nothing
    assert (
        np.isnan(table.loc["a", "iid", "misfit", 0]["caught"]) or table.loc["a", "iid", "misfit", 0]["failing"] < 0.05
    )
    assert "| A | test (OOD) |" in outputs[1].read_text(encoding="utf-8")


def test_the_expected_error_is_that_of_the_refined_version_where_there_is_one(tmp_path):
    sets, random = ("validation", "iid", "test"), np.random.default_rng(0)
    nothing = {f"{name}_expected": random.random((2, N)) for name in sets}
    plain = fake(tmp_path / "plain.npz", "a", [0, 1], spoiled=nothing)
    with np.load(plain) as arrays:
        moved = {f"{name}_moved": arrays[f"{name}_errors"] for name in sets}
    refined = fake(tmp_path / "refined.npz", "a~refined", [0, 1], spoiled=nothing | moved)
    labels = [("a", "A"), ("a~refined", "A refined")]
    outputs = [tmp_path / f"alarm.{end}" for end in ("csv", "md", "png")]
    alarm([plain, refined], outputs, asked(labels))
    found = pd.read_csv(outputs[0]).set_index(["method", "set", "score", "seed"])
    own, after = found.loc["a", "test", "expected", 0], found.loc["a~refined", "test", "expected", 0]
    assert own["auroc"] == 1 and own["caught"] == 1
    assert abs(after["auroc"] - 0.5) < 0.15
    assert "AUROC, expected error" in outputs[1].read_text(encoding="utf-8")


def test_alarms_of_all_versions_are_drawn_but_what_cannot_be_judged(tmp_path, drawn):
    """Not the floor's, nor a constant score's, nor those of a version of which hardly a window fails."""
    sound = {f"{name}_errors": np.full((2, N), 1e-9) for name in ("iid", "test")}
    still = {f"{name}_z_e_hat": np.ones((2, N, 1)) for name in ("validation", "iid", "test")}
    made = {"truth": None, "a+": None, "b": still, "fine": sound}
    files = [fake(tmp_path / f"{name}.npz", name, [0, 1], spoiled=spoiled) for name, spoiled in made.items()]
    job = asked([(name, name.upper()) for name in made], floor="truth")
    alarm(files, [tmp_path / "alarm.png", tmp_path / "alarm.csv"], job)
    (figure,) = drawn
    left, right = figure.axes
    names = [tick.get_text().split("\n") for tick in left.get_yticklabels()]
    assert [name for name, _ in names] == ["A+", "B"] and names[0][1].endswith(f"of {2 * N} fail)")
    marks = [line for line in left.lines if line.get_marker() not in ("", "None")]
    assert len(marks) == 3 + 1, "misfit, spread and density of A+; of B, whose estimates are constant, its misfit"
    table = pd.read_csv(tmp_path / "alarm.csv").query("set == 'test' and method == 'a+' and score == 'misfit'")
    assert marks[0].get_xdata()[0] == pytest.approx(table["auroc"].mean())
    low, high = next(line.get_xdata() for line in left.lines if len(set(line.get_xdata())) == 2)
    assert low < table["auroc"].min() and high <= 1
    assert right.get_xlabel().endswith("[%]") and figure.get_suptitle() == "e: alarms, test (OOD)"
    colours = {mark.get_color() for mark in marks}
    alarm(files[2:], [tmp_path / "alarm.png"], job)
    assert drawn[-1].axes[0].lines[1].get_color() in colours, "a score's colour is its own"
    alarm(files[3:], [tmp_path / "alarm.png"], job)
    assert drawn[-1].texts[0].get_text().startswith("No score can be judged")


def test_few_validation_windows_promise_the_share_that_they_can(files, tmp_path):
    for path in files:
        arrays = dict(np.load(path))
        ends = {"errors": 1, "misfit": 1, "tarp": 1, "ranks": 1, "z_e_hat": 1, "z_e": 0}
        kept = {f"validation_{end}": axis for end, axis in ends.items() if f"validation_{end}" in arrays}
        arrays |= {key: arrays[key].take(range(14), axis) for key, axis in kept.items()}
        np.savez(path, **arrays)
    outputs = [tmp_path / "alarm.csv", tmp_path / "alarm.md"]
    alarm(files, outputs, asked())
    assert "at a threshold of 6.7 % on the validation set" in outputs[1].read_text(encoding="utf-8")
    table = pd.read_csv(outputs[0]).set_index(["method", "set", "score", "seed"])
    # Of scores that know nothing 1 of 15 new windows is above the largest of 14, on the average.
    assert table.loc["a", "iid", "misfit", 0]["false_alarms"] < 0.3
    distance(files, [tmp_path / "distance.csv"], curves())


def test_files_from_before_are_refused_in_one_line(files, tmp_path):
    with np.load(files[0]) as arrays:
        np.savez(tmp_path / "old.npz", **{k: v for k, v in arrays.items() if not k.endswith("misfit")})
    with pytest.raises(InputError, match="no array 'test_misfit'; make it again with evaluate"):
        alarm([tmp_path / "old.npz"], [tmp_path / "alarm.csv"], asked())
