"""The study of coverage, on made-up draws that are too narrow, right or too wide."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from fake_windows import N, asked, fake

from expertaug.evaluation.coverage import run_stage as coverage


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
