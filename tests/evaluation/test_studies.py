"""Tables and figures of the studies."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from fake_runs import write_samples

from expertaug.cli import main
from expertaug.errors import InputError
from expertaug.evaluation import studies
from expertaug.evaluation.dots import LOOKS
from expertaug.evaluation.settings import SimulatedSet, StudyJob, StudyOptions
from expertaug.evaluation.studies import run_stage as study
from expertaug.evaluation.tabulate import run_stage as tabulate

COLUMNS = ["experiment", "system", "method", "label", "preset", "seed", "set", "metric", "value"]
SHIFTS = StudyOptions(
    distances=["none", "small"],
    panels=[("z_a shifted", ["validation", "near"]), ("z_a and z_e shifted", ["test", "both"])],
)
ENDS = ("csv", "md", "tex", "png")


def write(path, variants, sets, further=({},)):
    """Metrics of two seeds: the log-MSE counts up with variant, set and further columns."""
    rows = []
    for v, (method, label) in enumerate(variants.items()):
        for s, name in enumerate(sets):
            for k, more in enumerate(further):
                for seed in (0, 1):
                    values = {"log_mse_sum": v + 0.1 * s + 0.01 * k + seed, "relative_error": 10 * (v + 1) + s}
                    for metric, value in values.items():
                        row = ("swing", "p", method, label, "paper", seed, name, metric, value)
                        rows.append(dict(zip(COLUMNS, row, strict=True)) | more)
    pd.DataFrame(rows).to_csv(path, index=False)
    return path


def outputs(folder):
    return [folder / f"study.{end}" for end in ENDS]


def asked(name, labels, **more):
    return StudyJob(study=name, labels=list(labels.items()), from_s=None, hues=[("hybrid", 0)], **more)


def test_shifts(tmp_path, drawn):
    labels = {"hybrid": "Hybrid", "hybrid+": "Hybrid+"}
    path = write(tmp_path / "m.csv", labels, ("train", "validation", "test", "near", "both"))
    near = SimulatedSet(z_a={"alpha": (0.3, 0.6)})
    job = asked("out_of_expertise", labels, options=SHIFTS, sets={"near": near}, units={"alpha": "1/s"})
    study([path], [*outputs(tmp_path), tmp_path / "study.pdf"], job)
    assert (tmp_path / "study.pdf").read_bytes().startswith(b"%PDF")
    text = (tmp_path / "study.md").read_text()
    row = "| log-MSE | z_a shifted | small | alpha ∈ [0.3, 0.6] | 0.80 ± 0.71 | 1.80 ± 0.71 |"
    assert row in text and "Preset: paper" in text and "over 2 seeds" in text
    assert (tmp_path / "study.tex").read_text().isascii()
    assert len(pd.read_csv(tmp_path / "study.csv")) == 20
    left, right = drawn[0].axes
    assert [list(c.lines[0].get_ydata()) for c in left.containers] == [
        pytest.approx([0.6, 0.8]),
        pytest.approx([1.6, 1.8]),
    ]
    assert right.get_title() == "$z_a$ and $z_e$ shifted"
    assert left.get_xticklabels()[1].get_text() == "small\n$\\alpha$: 0.3 to\n0.6 1/s"


def test_bars_are_the_tables_intervals(tmp_path, drawn):
    """Of seeds and samples, as the experiment's own table has them; none of what no samples are kept."""
    path = write(tmp_path / "m.csv", {"hybrid": "Hybrid"}, ("validation", "test", "near", "both"))
    errors = {s: np.exp(np.random.default_rng(3).normal(size=(2, 40))) for s in ("validation", "near")}
    samples = write_samples(tmp_path / "f.npz", "hybrid", (0, 1), errors, preset="paper")
    job = asked("out_of_expertise", {"hybrid": "Hybrid"}, options=SHIFTS)
    study([path], outputs(tmp_path), job, [samples])
    tabulate([path], [tmp_path / "t_long.csv"], forecasts=[samples])
    table = pd.read_csv(tmp_path / "t_long.csv").query("metric == 'log_mse_sum'").set_index("set")
    left, right = (axis.containers[0].lines[2][0].get_segments() for axis in drawn[0].axes)
    for bar, name in zip(left, ("validation", "near"), strict=True):
        assert list(bar[:, 1]) == pytest.approx(list(table.loc[name, ["low", "high"]]))
        assert np.ptp(bar[:, 1]) > 0
    assert all(np.ptp(bar[:, 1]) == 0 for bar in right)
    assert drawn[0].get_suptitle() == "swing"
    row = next(line for line in (tmp_path / "study.md").read_text().splitlines() if "z_a shifted | small" in line)
    assert row.endswith("] |") and "95 % interval, for which samples" in (tmp_path / "study.md").read_text()
    given = tmp_path / "told.md"
    arguments = ["study", str(path), str(samples), "--output", str(given)]
    assert main([*arguments, "--settings", job.model_dump_json()]) == 0
    assert given.read_text() == (tmp_path / "study.md").read_text(), "the command takes both kinds of files"


def test_horizons(tmp_path, drawn):
    labels = {"hybrid": "Hybrid", "hybrid+": "Hybrid+"}
    path = write(tmp_path / "m.csv", labels, ("train", "validation", "test", "validation_1s", "test_1s"))
    panels = [("validation", ["validation", "validation_1s"]), ("test", ["test", "test_1s"])]
    options = StudyOptions(distances=["0.19 s", "1 s"], panels=panels)
    study([path], outputs(tmp_path), asked("horizons", labels, options=options))
    text = (tmp_path / "study.md").read_text()
    assert "| metric | set | until | Hybrid | Hybrid+ |" in text
    assert "| log-MSE | test (OOD) | 1 s | 0.90 ± 0.71 | 1.90 ± 0.71 |" in text
    right = drawn[0].axes[1]
    assert right.get_title() == "test (OOD)" and right.get_xlabel() == "end of the forecast"
    assert list(right.containers[0].lines[0].get_ydata()) == pytest.approx([0.7, 0.9])


def test_widths_are_in_the_order_of_their_volume(tmp_path, drawn):
    labels = {"hybrid": "Hybrid", "hybrid+": "Hybrid+", "hybrid+wide": "Hybrid+ (wide)"}
    labels["hybrid+narrow"] = "Hybrid+ (narrow)"
    path = write(tmp_path / "m.csv", labels, ("train", "validation", "test"))
    priors = {"": {"w": [0, 3]}, "wide": {"w": [0, 9]}, "narrow": {"w": [1, 2]}}
    study([path], outputs(tmp_path), asked("prior_width", labels, priors={"hybrid": priors}))
    rows = [line.split(" | ")[:2] for line in (tmp_path / "study.md").read_text().splitlines() if "Hybrid" in line]
    order = ["Hybrid", "Hybrid+ (narrow)", "Hybrid+", "Hybrid+ (wide)"]
    assert [row[0].removeprefix("| ") for row in rows] == order and rows[3][1] == "w ∈ [0, 9]"
    errors = drawn[0].axes[1].containers[1].lines[0].get_ydata()
    assert list(errors) == [12, 42, 22, 32], "test set: as trained, narrow, default, wide"
    assert studies.by_width({"": {"a": [0, 1], "b": [0, 1]}, "n": {"a": [0, 2], "b": [0, 0.1]}}) == ["n", ""]


def test_widths_of_methods_with_priors_of_their_own(tmp_path, drawn):
    labels = {m + name: f"{m} {name}" for m in ("one", "two") for name in ("", "+", "+wide")}
    path = write(tmp_path / "m.csv", labels, ("train", "validation", "test"))
    priors = {m: {"": {"w": [low, 3]}, "wide": {"w": [0, 9]}} for m, low in (("one", 1), ("two", 2))}
    study([path], outputs(tmp_path), asked("prior_width", labels, priors=priors))
    table = (tmp_path / "study.md").read_text()
    assert "| one + | w ∈ [1, 3] |" in table and "| two + | w ∈ [2, 3] |" in table
    ticks = [tick.get_text() for tick in drawn[0].axes[0].get_xticklabels()]
    assert ticks == ["none", "default\n", "wide\n0 to 9"], "the axis cannot say what differs"
    markers = {handle.get_label(): handle.get_marker() for handle in drawn[0].legends[0].legend_handles}
    assert {LOOKS[name][0] for name in ("validation", "test")} == set(markers.values()) - {"None", ""}


def test_during_training(tmp_path, drawn):
    places = [{"epoch": e, "finetune_epochs": f} for e in (1, 10) for f in (0, 1, 10)]
    path = write(tmp_path / "m.csv", {"hybrid": "Hybrid"}, ("train", "validation", "test"), places)
    options = StudyOptions(method="hybrid", epochs=[1, 10], finetune_epochs=[1, 10])
    job = asked("during_training", {"hybrid": "Hybrid"}, options=options)
    study([path], outputs(tmp_path), job)
    text = (tmp_path / "study.md").read_text()
    cell = re.search(r"\| 10 \| – \| 0.53 \[(.*?), (.*?)\]", text)  # Student's t of two seeds, one apart
    low, high = (float(end.replace("−", "-")) for end in cell.groups())
    assert high - 0.53 == pytest.approx(0.5 * 12.7, rel=0.2) and low - 0.53 == pytest.approx(-0.5 * 12.7, rel=0.2)
    assert "95 % interval, that their spread gives" in text
    bars = drawn[0].axes[0].containers[0].lines[2][0].get_segments()
    assert np.ptp(bars[1][:, 1]) == pytest.approx(high - low, abs=0.02)
    panels = [axis.containers for axis in drawn[0].axes]
    assert [len(lines) for lines in panels] == [3, 3, 3], "a panel a set"
    assert list(panels[2][0].lines[0].get_ydata()) == pytest.approx([0.7, 0.73])
    assert [line.lines[0].get_marker() for line in panels[0]] == ["o", "s", "*"]
    with pytest.raises(InputError, match="no column 'epoch'"):
        study([write(tmp_path / "n.csv", {"hybrid": "Hybrid"}, ("test",))], outputs(tmp_path), job)


def test_bad_requests(tmp_path):
    labels = {"hybrid": "Hybrid"}
    path = write(tmp_path / "m.csv", labels, ("validation", "test", "near"))
    with pytest.raises(InputError, match="no metrics of the set 'both'; evaluate again"):
        study([path], outputs(tmp_path), asked("out_of_expertise", labels, options=SHIFTS))
    widths = asked("prior_width", labels, priors={"hybrid": {"": {"w": (0, 1)}}})
    with pytest.raises(InputError, match=r"suffix '\.svg'"):
        study([path], [tmp_path / "x.svg"], widths)
