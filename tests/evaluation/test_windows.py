"""Studies of single windows: alarms, coverage and curves by distance, on made-up forecasts whose answer is known."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from expertaug.errors import InputError
from expertaug.evaluation.alarms import run_stage as alarm
from expertaug.evaluation.coverage import run_stage as coverage
from expertaug.evaluation.distance import beyond
from expertaug.evaluation.distance import run_stage as distance
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.settings import WindowStudyJob
from expertaug.evaluation.windows import windows_of
from expertaug.hues import EQUATION

N, S = 400, 2
RANGE = {"omega0": [1.5, 3.1]}
LABELS = [("a", "A"), ("a+~flow", "A+ flow")]


def asked(labels=LABELS, **more):
    return WindowStudyJob(labels=labels, hues=[("a", 0)], **more)


def curves(labels=LABELS, **more):
    return asked(labels, training_range=RANGE, **more)


def fake(path, method, seeds, width=1.0, failing=0.5, spoiled=None):
    """Windows whose error grows with the distance, and whose misfit tells which forecasts fail."""
    random = np.random.default_rng([len(method), *seeds])
    arrays = {"version": np.array(["e", "corrected", method]), "seeds": np.array(seeds), "failed": np.array([], int)}
    arrays |= {"t": np.arange(3.0), "observed": np.array(1), "state_names": ["theta"], "state_units": ["rad"]}
    arrays |= {"parameter_names": ["omega0"], "parameter_units": ["rad/s"], "rank_draws": np.array(119)}
    for name, (low, high) in {"validation": (1.5, 3.1), "iid": (1.5, 3.1), "test": (0.5, 1.5)}.items():
        z_e = np.random.default_rng(len(name)).uniform(low, high, (N, 1))
        away = beyond(z_e, ["omega0"], RANGE)
        bad = away > failing
        misfit = 1e-4 * (1 + random.random((len(seeds), N))) + 1e-2 * bad
        arrays[f"{name}_z_e"] = z_e
        arrays[f"{name}_errors"] = 1e-3 * (1 + random.random((len(seeds), N))) + bad
        arrays[f"{name}_misfit"] = misfit
        arrays[f"{name}_z_e_hat"] = z_e + 0.01 * random.standard_normal((len(seeds), N, 1))
        if width:
            draws = random.standard_normal((119, len(seeds), N)) * width
            arrays[f"{name}_ranks"] = (draws < random.standard_normal((len(seeds), N))).sum(0)[..., None]
            arrays[f"{name}_tarp"] = random.integers(0, 120, (len(seeds), N))
            arrays[f"{name}_inside"] = np.broadcast_to([0.4, 0.8], (len(seeds), 30, 2))
    if width:
        arrays |= {f"own_{key}": arrays[f"iid_{key}"] for key in ("ranks", "tarp", "inside")}
    arrays |= spoiled or {}
    np.savez(path, **arrays)
    return path


@pytest.fixture
def files(tmp_path):
    made = [("a", [0], None), ("a", [1], None), ("a+~flow", [0], 1.0), ("a+~flow", [1], 1.0)]
    return [fake(tmp_path / f"{k}.npz", method, seeds, width) for k, (method, seeds, width) in enumerate(made)]


def test_seeds_of_all_groups_come_together(files):
    found = windows_of(map(Forecasts.load, files))
    assert list(found) == ["a", "a+~flow"] and found["a"].seeds == [0, 1]
    assert found["a"].sets["test"].errors.shape == (2, N) and found["a"].sets["test"].drawn is None
    assert found["a+~flow"].sets["iid"].drawn.ranks.shape == (2, N, 1)


def test_an_alarm_that_knows_is_told_from_one_that_does_not(files, tmp_path):
    outputs = [tmp_path / f"alarm.{end}" for end in ("csv", "md", "tex", "png", "pdf")]
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


def test_coverage_of_all_versions_is_drawn_but_the_floors(tmp_path, drawn):
    """A share of windows within an interval at each level, the mean over seeds."""
    names = ("truth", "a+~flow", "b~refined")
    files = [
        fake(tmp_path / f"{name}.npz", name, [0, 1], width) for name, width in zip(names, (1, 1, 0.3), strict=True)
    ]
    job = asked([(name, name) for name in names], floor="truth")
    coverage(files, [tmp_path / "coverage.png", tmp_path / "coverage.csv"], job)
    panels = drawn[0].axes
    assert [axis.get_title() for axis in panels] == ["the model's own windows", "IID test", "test (OOD)"]
    assert [len(axis.lines) for axis in panels] == [3, 3, 3]
    table = pd.read_csv(tmp_path / "coverage.csv").query("set == 'test' and parameter == 'omega0' and not pooled")
    for line, name in zip(panels[2].lines[1:], names[1:], strict=True):
        at = line.get_ydata()[list(line.get_xdata()).index(90.0)]
        assert at == pytest.approx(100 * table.set_index("method").loc[name, "coverage_90"])


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


@pytest.mark.parametrize(("width", "low", "high"), [(1.0, 0.85, 0.95), (0.3, 0.0, 0.5), (3.0, 0.97, 1.0)])
def test_coverage_says_too_narrow_right_and_too_wide(tmp_path, width, low, high):
    file = fake(tmp_path / "x.npz", "a+~flow", [0, 1], width)
    outputs = [tmp_path / f"coverage.{end}" for end in ("csv", "md", "tex", "png")]
    coverage([file], outputs, asked())
    table = pd.read_csv(outputs[0]).query("not pooled").set_index(["set", "parameter"])
    assert low <= table.loc[("test", "omega0"), "coverage_90"] <= high
    assert table.loc[("own", "omega0"), "coverage_90"] == table.loc[("iid", "omega0"), "coverage_90"]
    assert table.loc[("own", "forecast"), "coverage_90"] == pytest.approx(0.8)
    assert table.loc[("test", "forecast"), "windows"] == 30 and np.isnan(table.loc[("test", "forecast"), "atc"])
    assert "| the model's own windows | forecast | 40.0 | 80.0 | – |" in outputs[1].read_text(encoding="utf-8")


def test_draws_of_all_seeds_are_one_posterior_together(tmp_path):
    random = np.random.default_rng(0)
    centre = np.array([-3.0, 3.0])[:, None, None]  # each seed is sure of another side
    ranks = (centre + random.standard_normal((2, 119, N)) < random.standard_normal(N)).sum(1)[..., None]
    file = fake(tmp_path / "x.npz", "a+~flow", [0, 1], spoiled={"test_ranks": ranks})
    outputs = [tmp_path / f"coverage.{end}" for end in ("csv", "md")]
    coverage([file], outputs, asked())
    rows = pd.read_csv(outputs[0]).query("set == 'test' and parameter == 'omega0'").set_index("pooled")["coverage_90"]
    assert rows[False] < 0.2 and rows[True] > 0.95
    assert "| A+ flow | test (OOD) | omega0, seeds pooled |" in outputs[1].read_text(encoding="utf-8")
    assert not pd.read_csv(outputs[0]).query("set == 'own'")["pooled"].any()


def test_points_alone_have_no_coverage(tmp_path):
    file = fake(tmp_path / "x.npz", "a", [0], width=None)
    outputs = [tmp_path / f"coverage.{end}" for end in ("csv", "md", "tex", "png")]
    coverage([file], outputs, asked())
    assert "No version has intervals" in outputs[1].read_text(encoding="utf-8") and outputs[3].exists()


def test_curves_by_distance(files, tmp_path):
    outputs = [tmp_path / f"distance.{end}" for end in ("csv", "md", "tex", "png", "pdf")]
    distance(files, outputs, curves())
    of_a = pd.read_csv(outputs[0]).query("method == 'a'")
    assert (of_a["of"] == "z_e").all()
    assert of_a["distance"].iloc[0] == 0 and of_a["distance"].is_monotonic_increasing and len(of_a) == 7
    assert of_a["windows"].sum() == 2 * N
    assert of_a["alarms"].iloc[0] < 10 and of_a["alarms"].iloc[-1] > 90
    assert of_a["log_mse"].iloc[-1] > of_a["log_mse"].iloc[0] + 3 and of_a["skill"].isna().all()
    distance(files, outputs, curves(floor="a+~flow", mean="a"))
    table = pd.read_csv(outputs[0])
    assert np.allclose(table.query("method == 'a'")["skill"], 0)
    assert np.allclose(table.query("method == 'a+~flow'")["skill"], 1)


def test_curves_have_the_intervals_of_windows_and_seeds(files, tmp_path, drawn):
    """Windows alike in all but noise: their mean is in the interval, which few windows widen and 0 bounds."""
    random = np.random.default_rng(3)
    sets = ("validation", "iid", "test")
    errors = {f"{name}_errors": np.stack([random.exponential(1e-3, N)] * 2) for name in sets}
    least = {key: np.full((2, N), 1.0) for key in errors}
    made = [("b", errors), ("truth", {key: 1e-2 * values for key, values in errors.items()}), ("mean", least)]
    paths = [fake(tmp_path / f"{name}.npz", name, [0, 1], spoiled=spoiled) for name, spoiled in made]
    job = curves([(name, name) for name, _ in made], floor="truth", mean="mean")
    outputs = [tmp_path / f"curves.{end}" for end in ("csv", "md", "png")]
    distance(paths, outputs, job)
    table = pd.read_csv(outputs[0]).query("method == 'b'")
    width = table["log_mse_high"] - table["log_mse_low"]
    assert table["log_mse_low"].lt(np.log(1e-3)).all() and table["log_mse_high"].gt(np.log(1e-3)).all()
    assert width.iloc[0] < width.iloc[1:].min(), "400 windows within the range, about 67 in a bin beyond"
    # The floor's errors are a hundredth of the same windows': what they share is no spread of the skill.
    skill = np.log(1e3) / np.log(1e5)
    assert table["skill_low"].lt(skill).all() and table["skill_high"].gt(skill).all()
    assert (table["skill_high"] - table["skill_low"]).lt(0.6 * width / np.log(1e5)).all()
    assert table["alarms_low"].ge(0).all() and table["alarms_high"].le(100).all()
    assert f"{table['log_mse'].iloc[0]:.2f} [".replace("-", "−") in outputs[1].read_text(encoding="utf-8")
    assert len(drawn[0].axes[0].collections) == 2, "error bars of b and truth; the mean's errors do not differ"


def test_curves_have_seven_lines_with_the_true_equation(tmp_path, drawn):
    names = [*(f"m{k}" for k in range(9)), "truth"]
    files = [fake(tmp_path / f"{name}.npz", name, [0, 1]) for name in names]
    job = curves([(name, name) for name in names], floor="truth")
    distance(files, [tmp_path / "distance.png"], job)
    log_mse = drawn[0].axes[0]
    assert len(log_mse.lines) == 7
    assert drawn[0].axes[0].lines[-1].get_color() == EQUATION


def test_a_true_equation_far_below_leaves_the_panel_to_the_others(files, tmp_path, drawn):
    sets = ("validation", "iid", "test")
    far = {f"{name}_errors": np.full((2, N), 1e-20) for name in sets}
    path = fake(tmp_path / "truth.npz", "truth", [0, 1], spoiled=far)
    job = curves([*LABELS, ("truth", "True equation")], floor="truth")
    distance([*files, path], [tmp_path / "distance.png"], job)
    axis = drawn[0].axes[0]
    assert axis.get_ylim()[0] > -10 and [text.get_text() for text in axis.texts] == ["True equation: −46"]


def test_curves_by_the_distance_of_z_a_too(tmp_path):
    """The farther alpha, the larger the error; windows whose z_e lies out of the range do not count."""
    random, extra = np.random.default_rng(0), {"interaction_names": np.array(["alpha"])}
    for name, far in (("iid", 0.0), ("validation", 0.0), ("test", 0.0), ("z_a_small", 0.3), ("both_small", 0.3)):
        alpha = random.uniform(far, 0.3 + far, (N, 1))
        z_e = random.uniform(0.5, 1.4, (N, 1)) if name in ("test", "both_small") else random.uniform(1.5, 3.1, (N, 1))
        away = np.maximum(alpha[:, 0] - 0.3, 0) / 0.3
        errors = 1e-3 * np.exp(4 * away) + (z_e[:, 0] < 1.5)
        extra |= {f"{name}_z_a": alpha, f"{name}_z_e": z_e, f"{name}_errors": np.stack([errors] * 2)}
        extra |= {f"{name}_misfit": np.full((2, N), 1e-4), f"{name}_z_e_hat": np.stack([1.01 * z_e] * 2)}
    file = fake(tmp_path / "x.npz", "a", [0, 1], width=None, spoiled=extra)
    outputs = [tmp_path / f"distance.{end}" for end in ("csv", "md", "tex", "png")]
    distance([file], outputs, curves(interaction_range={"alpha": (0.0, 0.3)}))
    table = pd.read_csv(outputs[0])
    curve = table.query("of == 'z_a'")
    assert curve["windows"].sum() == 2 * N, "iid and z_a_small"
    assert curve["distance"].iloc[0] == 0 and curve["log_mse"].iloc[-1] > curve["log_mse"].iloc[0] + 3
    np.testing.assert_allclose(curve["log_mse"].iloc[1:], np.log(1e-3) + 4 * curve["distance"].iloc[1:], atol=0.2)
    assert (table["of"] == "z_e").sum() == 7
    assert "*z_a within the range (" in outputs[1].read_text(encoding="utf-8")


def test_distance_is_in_widths_of_the_range_the_largest_over_parameters():
    ranges = {"a": [1.0, 3.0], "b": [0.0, 1.0]}
    z_e = np.array([[2.0, 0.5], [0.0, 0.5], [2.0, 1.5], [5.0, -0.25]])
    np.testing.assert_allclose(beyond(z_e, ["a", "b"], ranges), [0, 0.5, 0.5, 1.0])
    one = {"a": (1.0471975512, 1.0471975512)}  # rounded, and beside a parameter that has no range
    np.testing.assert_array_equal(beyond(np.float32([[1.0471975512, 9.0]]), ["a", "friction"], one), [0.0])


def test_files_from_before_are_refused_in_one_line(files, tmp_path):
    with np.load(files[0]) as arrays:
        np.savez(tmp_path / "old.npz", **{k: v for k, v in arrays.items() if not k.endswith("misfit")})
    with pytest.raises(InputError, match="no array 'test_misfit'; make it again with evaluate"):
        alarm([tmp_path / "old.npz"], [tmp_path / "alarm.csv"], asked())
