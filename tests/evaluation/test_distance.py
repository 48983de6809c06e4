"""Curves by the distance from the training range, on made-up forecasts whose errors grow with it."""

from __future__ import annotations

import numpy as np
import pandas as pd
from fake_windows import LABELS, N, curves, fake

from expertaug.evaluation.distance import beyond
from expertaug.evaluation.distance import run_stage as distance
from expertaug.hues import EQUATION


def test_curves_by_distance(files, tmp_path):
    outputs = [tmp_path / f"distance.{end}" for end in ("csv", "md", "tex", "png", "pdf")]
    distance(files, outputs, curves())
    of_a = pd.read_csv(outputs[0]).query("method == 'a'")
    assert (of_a["of"] == "z_e").all()
    assert of_a["distance"].iloc[0] == 0 and of_a["distance"].is_monotonic_increasing and len(of_a) == 7
    assert of_a["windows"].sum() == 2 * N
    assert of_a["alarms"].iloc[0] < 10 and of_a["alarms"].iloc[-1] > 90
    assert of_a["log_mse"].iloc[-1] > of_a["log_mse"].iloc[0] + 3 and of_a["skill"].isna().all()
    distance(files, outputs[:1], curves(floor="a+~flow", mean="a"))
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
    outputs = [tmp_path / f"distance.{end}" for end in ("csv", "md")]
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
