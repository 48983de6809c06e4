"""Tables of metrics against values computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from fake_runs import LABELS, pairs, write_metrics, write_samples

from expertaug.errors import InputError
from expertaug.evaluation.settings import TabulateJob
from expertaug.evaluation.summary import TabledMean, read_metrics
from expertaug.evaluation.tabulate import run_stage as tabulate
from expertaug.rows import read_csv

HEAD = "experiment,system,method,label,preset,seed,set,metric,value\n"


def write(path, rows):
    path.write_text(HEAD + "".join(f"swing,pendulum,{method},{label},{rest}\n" for method, label, rest in rows))
    return path


@pytest.fixture
def three_seeds(tmp_path):
    rows = [("a", "A", f"paper,{seed},test,log_mse_sum,{value}") for seed, value in enumerate((-1.0, -2.0, -4.5))]
    rows += [("a", "A", f"paper,{seed},test,relative_error,{value}") for seed, value in enumerate((5, 7, 9))]
    rows += [("a+", "A+", f"paper,{seed},test,log_mse_sum,{-3 - seed}") for seed in range(3)]
    return [write(tmp_path / "metrics.csv", rows)]


def test_mean_and_deviation_over_seeds(tmp_path, three_seeds):
    tabulate(three_seeds, [tmp_path / "t.csv", tmp_path / "t_long.csv"])
    wide = pd.read_csv(tmp_path / "t.csv").set_index("label")
    assert wide.loc["A", "test/log_mse_sum/mean"] == pytest.approx(-2.5, abs=1e-15)
    assert wide.loc["A", "test/log_mse_sum/std"] == pytest.approx(math.sqrt(3.25), abs=1e-15)
    assert wide.loc["A", "test/log_mse_sum/n"] == 3
    assert math.isnan(wide.loc["A+", "test/relative_error/mean"])
    long = pd.read_csv(tmp_path / "t_long.csv")
    row = long[(long["label"] == "A") & (long["metric"] == "relative_error")].iloc[0]
    assert (row["mean"], row["std"], row["n"], row["seeds"]) == (7.0, 2.0, 3, "0 1 2")


def test_csv_has_full_precision(tmp_path):
    value = 1 / 3
    path = write(tmp_path / "metrics.csv", [("a", "A", f"paper,0,test,log_mse_sum,{value!r}")])
    tabulate([path], [tmp_path / "t.csv"])
    assert pd.read_csv(tmp_path / "t.csv", float_precision="round_trip")["test/log_mse_sum/mean"][0] == value


def test_markdown(tmp_path, three_seeds):
    tabulate(three_seeds, [tmp_path / "t.md"], TabulateJob(labels=[], from_s=None))
    text = (tmp_path / "t.md").read_text()
    assert "Preset: paper." in text
    assert "over 3 seeds" in text
    assert "convention: sum" in text
    assert "(t1, t2]" in text
    assert "| A | 3 | −2.50 ± 1.80 | 7.0 ± 2.0 |" in text
    assert "| A+ | 3 | **−4.00 ± 1.00** | – |" in text


def test_latex(tmp_path, three_seeds):
    tabulate(three_seeds, [tmp_path / "t.tex"])
    text = (tmp_path / "t.tex").read_text()
    assert r"A & 3 & $-2.50 \pm 1.80$ & $7.0 \pm 2.0$ \\" in text
    assert r"A+ & 3 & $\mathbf{-4.00} \pm 1.00$ & -- \\" in text
    assert r"\cmidrule(lr){3-4}" in text
    assert r"error [\%]" in text
    assert text.count("{") == text.count("}")
    assert text.isascii()


def test_methods_of_known_form_stand_below_a_rule_and_do_not_compete(tmp_path):
    values = {"told": -5, "told+": -6, "net": -4, "net+": -3}
    rows = [(m, m.title(), f"paper,{seed},test,log_mse_sum,{v - seed}") for m, v in values.items() for seed in (0, 1)]
    labels = [(m, m.title()) for m in ("net", "net+", "told", "told+")]
    job = TabulateJob(labels=labels, known_form=["told", "told+"])
    tabulate([write(tmp_path / "m.csv", rows)], [tmp_path / "t.md", tmp_path / "t.tex"], job)
    lines = [line.split("|")[1].strip() for line in (tmp_path / "t.md").read_text().splitlines() if "|" in line]
    assert lines[2:7] == ["Net", "Net+", "*F_a of known form, which does not compete:*", "Told", "Told+"]
    assert "**−4.50" in (tmp_path / "t.md").read_text()
    body = (tmp_path / "t.tex").read_text().split(r"\midrule")
    assert len(body) == 3 and "Net+" in body[1] and "Told" in body[2]


def test_one_seed_has_no_deviation(tmp_path):
    metrics = write_metrics(tmp_path, seeds=(4,))
    tabulate(metrics, [tmp_path / "t.md", tmp_path / "t.csv", tmp_path / "t.tex"])
    text = (tmp_path / "t.md").read_text()
    assert "over 1 seed per method" in text
    assert "± –" in text
    assert "nan" not in text + (tmp_path / "t.tex").read_text()
    assert pd.read_csv(tmp_path / "t.csv")["test/log_mse_sum/std"].isna().all()


def test_blocks_of_seeds_are_joined(tmp_path):
    metrics = write_metrics(tmp_path, seeds=(0, 1)) + write_metrics(tmp_path, seeds=(2, 3))
    tabulate(metrics, [tmp_path / "t.csv"])
    assert set(pd.read_csv(tmp_path / "t.csv")["test/log_mse_sum/n"]) == {4}


def test_seed_that_is_not_finite_is_counted_out(tmp_path):
    rows = [("a", "A", f"paper,{seed},test,log_mse_sum,{value}") for seed, value in enumerate((-1, -3, "inf"))]
    path = write(tmp_path / "metrics.csv", rows)
    tabulate([path], [tmp_path / "t.md"])
    assert "−2.00 ± 1.41 (2/3)" in (tmp_path / "t.md").read_text()


def test_each_seed_is_kept_and_the_worst_is_told(tmp_path):
    rows = [("a", "A", f"paper,{seed},test,log_mse_sum,{value}") for seed, value in enumerate((-4.5, -3.4, "inf", -4))]
    rows += [("b", "B", f"paper,{seed},test,log_mse_sum,{value}") for seed, value in enumerate((-4.5, -3.4, -3.6, -4))]
    rows += [("c", "C", "paper,0,test,log_mse_sum,-9")]
    rows += [("d", "D", f"paper,{seed},test,log_mse_sum,{value}") for seed, value in enumerate((-4, "nan"))]
    tabulate([write(tmp_path / "metrics.csv", rows)], [tmp_path / "t.md", tmp_path / "t_long.csv"])
    text = (tmp_path / "t.md").read_text()
    assert "| A | 4 | not finite (2) |" in text and "| B | 4 | −3.40 (1) |" in text and "| C | 1 | −9.00 (" not in text
    assert "| D | 2 | not finite (1) |" in text
    (long,) = [mean for mean in read_csv(tmp_path / "t_long.csv", TabledMean, "") if mean.method == "b"]
    assert long.seeds == (0, 1, 2, 3) and long.values == (-4.5, -3.4, -3.6, -4.0) and long.seeds_behind(1.0) == 1


def test_two_presets_do_not_mix(tmp_path):
    paths = [
        write(tmp_path / f"{preset}.csv", [("a", "A", f"{preset},0,test,log_mse_sum,{value}")])
        for preset, value in {"paper": 1, "corrected": 3}.items()
    ]
    tabulate(paths, [tmp_path / "t.csv"])
    table = pd.read_csv(tmp_path / "t.csv").set_index("label")["test/log_mse_sum/mean"]
    assert table.to_dict() == {"A (paper)": 1, "A (corrected)": 3}


def test_rows_and_columns_are_in_order(tmp_path):
    metrics = write_metrics(tmp_path, labels=LABELS[::-1])
    tabulate(metrics, [tmp_path / "t_long.csv"], TabulateJob(labels=pairs()["labels"]))
    long = pd.read_csv(tmp_path / "t_long.csv")
    assert list(dict.fromkeys(long["label"])) == list(LABELS)
    assert list(dict.fromkeys(long["set"])) == ["train", "validation", "test"]


def test_runaways_are_a_column_where_there_are_any_and_the_median_is_told(tmp_path):
    values = {"log_mse_sum": 3.0, "log_mse_median": -2.0, "runaway_share": 0.0}
    rows = [
        ("ab"[k], "AB"[k], f"paper,{seed},{name},{metric},{value + (0.25 * k * seed * (name == 'test'))}")
        for k in (0, 1)
        for seed in (0, 1)
        for name in ("validation", "test")
        for metric, value in values.items()
    ]
    path = write(tmp_path / "metrics.csv", rows)
    tabulate([path], [tmp_path / f"t.{end}" for end in ("md", "tex", "csv")])
    text = (tmp_path / "t.md").read_text()
    header = "validation (set of choices): log-MSE | test (OOD): log-MSE | test (OOD): runaways [%]"
    assert f"| method | seeds | {header} |" in text
    assert "| B | 2 | 3.00 ± 0.00 | 3.12 ± 0.18 | 12.5 ± 17.7 |" in text and "Runaways: forecasts that leave" in text
    assert "| log-MSE, median sample (log_mse_median) | A | −2.00 ± 0.00 | −2.00 ± 0.00 |" in text
    assert r"runaways [\%]" in (tmp_path / "t.tex").read_text()
    assert pd.read_csv(tmp_path / "t.csv").set_index("label").loc["B", "test/runaway_share/mean"] == 0.125
    tabulate([write(tmp_path / "none.csv", rows[:6])], [tmp_path / "none.md"])
    assert "unaways" not in (tmp_path / "none.md").read_text()


def test_what_an_estimate_costs_is_the_last_column(tmp_path):
    """Of one set; seeds of one job share its time, which then has no deviation, and the cheapest is not the best."""
    values = {"a": (0.02, 0.02), "b": (57.0, 59.0)}
    rows = [
        (method, method.upper(), f"paper,{seed},{name},{metric},{value}")
        for method, costs in values.items()
        for seed, cost in enumerate(costs)
        for name in ("validation", "test")
        for metric, value in {"log_mse_sum": 3.0, "estimate_ms": cost}.items()
    ]
    path = write(tmp_path / "metrics.csv", rows)
    tabulate([path], [tmp_path / "t.md", tmp_path / "t.tex"])
    text = (tmp_path / "t.md").read_text()
    assert "validation (set of choices): log-MSE | test (OOD): log-MSE | test (OOD): estimate [ms] |" in text
    assert "**3.00 ± 0.00** | 0.0200 |\n" in text and "3.00 ± 0.00 | 58.0 ± 1.4 |\n" in text
    assert "Estimate: processor time" in text and "Further" not in text
    assert r"& $0.0200$ \\" in (tmp_path / "t.tex").read_text()


def test_every_cell_has_a_value_when_a_seed_failed(tmp_path):
    rows = [
        ("a", "A", f"paper,{seed},test,{metric},{value}")
        for metric in ("log_mse_sum", "runaway_share", "relative_error")
        for seed, value in enumerate((0.5, "", 0.25))
    ]
    tabulate([write(tmp_path / "metrics.csv", rows)], [tmp_path / "t.md"])
    assert "| A | 3 | 0.38 ± 0.18 (2/3) | 0.4 ± 0.2 (2/3) | 37.5 ± 17.7 (2/3) |" in (tmp_path / "t.md").read_text()


def test_a_label_may_look_like_another_version(tmp_path):
    """What is augmented follows from the method: these labels end in a + or in brackets behind one."""
    rows = [
        (method, label, f"paper,0,test,log_mse_sum,{k}")
        for k, (method, label) in enumerate(
            {"one": "A+", "two": "A+ (x)", "one+": "A++", "two+w": "A+ (x)+ (w)"}.items()
        )
    ]
    tabulate([write(tmp_path / "metrics.csv", rows)], [tmp_path / "t_long.csv"])
    assert list(pd.read_csv(tmp_path / "t_long.csv")["method"]) == ["one", "one+", "two", "two+w"]


def test_dim_convention_and_own_titles(tmp_path):
    metrics = write_metrics(tmp_path)
    job = TabulateJob(labels=[], convention="dim", set_titles={"validation": "middle energies"})
    tabulate(metrics, [tmp_path / "t.md"], job)
    text = (tmp_path / "t.md").read_text()
    assert "averaged over the observed dimensions (convention: dim)" in text
    assert "middle energies: log-MSE" in text
    place = ("Hybrid", "test", "log_mse_dim")
    values = [row.value for row in read_metrics(metrics) if (row.label, row.set, row.metric) == place]
    assert f"{np.mean(values):.2f}".replace("-", "−") in text


SETS = ("train", "validation", "iid", "test")


def write_runs(folder, versions, ids=None, seeds=(0, 1, 2)):
    """Metrics and samples' errors of versions: the log of their errors is ``versions[name]`` and a spread that all
    versions share, of samples above all."""
    rng = np.random.default_rng(0)
    shared = {name: rng.normal(size=(1, 60)) + 0.05 * rng.normal(size=(len(seeds), 60)) for name in SETS}
    rows, forecasts = [], []
    for k, (name, level) in enumerate(versions.items()):
        own = np.random.default_rng(k + 1)
        errors = {s: np.exp(level + far + 0.05 * own.normal(size=far.shape)) for s, far in shared.items()}
        wrong = {s: 0.1 * np.exp(level) * np.ones((len(seeds), 60)) for s in SETS[1:]}
        forecasts.append(write_samples(folder / name / "forecasts.npz", name, seeds, errors, ids=ids, wrong=wrong))
        for s in SETS:
            values = {"log_mse_sum": np.log(errors[s].mean(1)), "log_mse_median": np.log(np.median(errors[s], axis=1))}
            values |= {"relative_error": 100 * wrong[s].mean(1)} if s in wrong else {}
            rows += [
                (name, name.upper(), f"corrected,{seed},{s},{metric},{value[k]}")
                for metric, value in values.items()
                for k, seed in enumerate(seeds)
            ]
    return [write(folder / "metrics.csv", rows)], forecasts


def test_what_is_printed_contains_the_spread_over_samples(tmp_path):
    metrics, forecasts = write_runs(tmp_path, {"a": -1.0, "b": 0.0})
    tabulate(metrics, [tmp_path / f"t.{end}" for end in ("md", "tex", "csv")], forecasts=forecasts)
    row = pd.read_csv(tmp_path / "t.csv").set_index("method").loc["a"]
    mean, std, low, high = (row[f"iid/log_mse_sum/{name}"] for name in ("mean", "std", "low", "high"))
    assert std < 0.02 and high - low > 0.4 and low < mean < high, "the seeds hardly differ, samples do"
    text = (tmp_path / "t.md").read_text()
    cell = f"{mean:.2f} [{low:.2f}, {high:.2f}]".replace("-", "−")
    assert f"**{cell}**" in text and "for which seeds and samples both are resampled" in text
    assert "IID test: log-MSE" in text and "validation (set of choices): log-MSE" in text
    assert rf"$\mathbf{{{mean:.2f}}}_{{{low:.2f}}}^{{{high:.2f}}}$" in (tmp_path / "t.tex").read_text()
    median = row["iid/log_mse_median/mean"], row["iid/log_mse_median/low"]
    assert f"| {median[0]:.2f} [{median[1]:.2f}, ".replace("-", "−") in text


def test_all_that_are_not_told_apart_from_the_best_are_bold(tmp_path):
    metrics, forecasts = write_runs(tmp_path, {"a": -1.0, "b": -1.0, "c": -0.8})
    tabulate(metrics, [tmp_path / "t.md"], forecasts=forecasts)
    lines = (tmp_path / "t.md").read_text().splitlines()
    test_set = {line.split(" | ")[0]: line.split(" | ")[-2] for line in lines if line.startswith("| ") and "**" in line}
    assert set(test_set) == {"| A", "| B"} and all(cell.startswith("**") for cell in test_set.values())


def test_a_gain_of_augmentation_is_one_over_the_control(tmp_path):
    """Training on gains .5 and augmentation .2 more for a; for b training on alone gains; c has no control."""
    levels = {"a": 0.0, "a=": -0.5, "a+": -0.7, "b": 0.0, "b=": -0.5, "b+": -0.5, "c": 0.0, "c+": -0.5}
    metrics, forecasts = write_runs(tmp_path, levels)
    tabulate(metrics, [tmp_path / f"t{end}" for end in (".md", ".tex", ".csv", "_long.csv")], forecasts=forecasts)
    table = pd.read_csv(tmp_path / "t.csv").set_index("method")
    assert list(table.index) == list(levels)
    for name, over_control, from_base in (("a+", 0.2, 0.7), ("b+", 0.0, 0.5), ("c+", math.nan, 0.5)):
        row = table.loc[name]
        assert row["test/log_mse_sum/gain"] == pytest.approx(over_control, abs=0.05, nan_ok=True)
        assert row["test/log_mse_sum/difference"] == pytest.approx(from_base, abs=0.05)
    assert table.loc["a+", "test/log_mse_sum/gain_p"] < 0.05 < table.loc["b+", "test/log_mse_sum/gain_p"]
    assert table.loc["a+", "test/log_mse_sum/gain_low"] > 0.1
    assert table.loc["a", [c for c in table if "gain" in c or "difference" in c]].isna().all()
    long = pd.read_csv(tmp_path / "t_long.csv").set_index(["method", "set", "metric"])
    wrong = 10 * (np.exp(-0.5) - np.exp(-0.7))
    assert long.loc[("a+", "iid", "relative_error"), "gain"] == pytest.approx(wrong, rel=1e-3)
    text = (tmp_path / "t.md").read_text()
    rows = {tuple(line.split(" | ")[:2]): line.split(" | ")[2:] for line in text.splitlines()}
    errors = rows["| A+", "gain over control"], rows["| B+", "gain over control"], rows["| C+", "difference from base"]
    assert [cells[-2].startswith("**0.") for cells in errors] == [True, False, True]
    assert {cell.strip(" |") for cell in rows["| C+", "gain over control"]} == {"–"}, "no control: no gain"
    assert "no gain of augmentation" in text and r"\label{tab:swing-gains}" in (tmp_path / "t.tex").read_text()
    assert (tmp_path / "t.tex").read_text().isascii()


def test_recordings_are_resampled_as_a_whole(tmp_path):
    ids = {name: [f"r{k // 10}/{k}" for k in range(60)] for name in SETS}
    metrics, forecasts = write_runs(tmp_path, {"a": 0.0}, ids)
    tabulate(metrics, [tmp_path / "t.md"], forecasts=forecasts)
    assert "seeds and whole recordings both are resampled" in (tmp_path / "t.md").read_text()


def test_the_error_of_parameters_that_nobody_knows_is_a_dash(tmp_path):
    """The version a estimates them, b does not; of both neither truth nor error is in any file."""
    metrics, forecasts = write_runs(tmp_path, {"a": -1.0, "b": 0.0})
    lines = [line for line in metrics[0].read_text().splitlines(True) if "relative_error" not in line]
    metrics[0].write_text("".join(lines))
    for path, estimates in zip(forecasts, (True, False), strict=True):
        kept = {name: value for name, value in np.load(path).items() if estimates or not name.endswith("_z_e_hat")}
        np.savez(path, **{k: np.full_like(v, np.nan) if k.endswith("_z_e") else v for k, v in kept.items()})
    tabulate(metrics, [tmp_path / f"t{end}" for end in (".md", ".tex", ".csv", "_long.csv")], forecasts=forecasts)
    text = (tmp_path / "t.md").read_text()
    head, _, *rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("|")]
    errors = [place for place, title in enumerate(head) if title.endswith("error [%]")]
    assert len(errors) == len(SETS) and [row[k] for row in rows[:2] for k in errors] == ["–"] * 2 * len(SETS)
    assert "nobody knows the truth" in text
    long = pd.read_csv(tmp_path / "t_long.csv").query("metric == 'relative_error'")
    assert set(long["method"]) == {"a"} and set(long["of"]) == {0} and long["mean"].isna().all()


def test_what_augmentation_gains_of_parameters_that_nobody_knows_is_not_told(tmp_path):
    metrics, forecasts = write_runs(tmp_path, {"a": 0.0, "a=": -0.1, "a+": -0.5})
    metrics[0].write_text("".join(s for s in metrics[0].read_text().splitlines(True) if "relative_error" not in s))
    for path in forecasts:
        kept = dict(np.load(path).items())
        np.savez(path, **{k: np.full_like(v, np.nan) if k.endswith("_z_e") else v for k, v in kept.items()})
    tabulate(metrics, [tmp_path / "t.md", tmp_path / "t.csv"], forecasts=forecasts)
    rows = [line for line in (tmp_path / "t.md").read_text().splitlines() if "gain over control" in line]
    assert len(rows) == 1 and rows[0].count("**0.") == len(SETS) and "nan" not in rows[0]


def test_forecasts_from_before_errors_of_samples_were_kept(tmp_path):
    metrics, forecasts = write_runs(tmp_path, {"a": 0.0})
    kept = {name: value for name, value in np.load(forecasts[0]).items() if name != "version"}
    np.savez(forecasts[0], **kept)
    with pytest.raises(InputError, match=r"no array 'version'; make it again with evaluate"):
        tabulate(metrics, [tmp_path / "t.md"], forecasts=forecasts)


def test_groups_of_seeds_have_the_same_samples(tmp_path):
    metrics, forecasts = write_runs(tmp_path, {"a": 0.0})
    other = write_samples(tmp_path / "more.npz", "a", [3], {name: np.ones((1, 5)) for name in SETS})
    with pytest.raises(InputError, match=r"more\.npz: other samples than .*forecasts\.npz"):
        tabulate(metrics, [tmp_path / "t.md"], forecasts=[*forecasts, other])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no rows"),
        (HEAD.replace(",value", ""), "no rows"),
        (HEAD.replace(",value", "") + "a,b,c,d,e,0,test,m\n", "line 2 has no 'value'"),
        (HEAD + "a,b,c,d,e,0,test,m,high\n", "line 2"),
    ],
)
def test_bad_files(tmp_path, text, message):
    (tmp_path / "metrics.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        tabulate([tmp_path / "metrics.csv"], [tmp_path / "t.csv"])
    assert not (tmp_path / "t.csv").exists()


def test_bad_requests(tmp_path, three_seeds):
    with pytest.raises(InputError, match="there twice"):
        tabulate(three_seeds * 2, [tmp_path / "t.csv"])
    with pytest.raises(InputError, match=r"one of \.csv, \.md, \.tex"):
        tabulate(three_seeds, [tmp_path / "t.xls"])
    timed = write(tmp_path / "timed.csv", [("a", "A", "paper,0,train,wall_s,3")])
    with pytest.raises(InputError, match=r"neither log-MSE nor parameter error.*they hold wall_s"):
        tabulate([timed], [tmp_path / "t.md"])
    with pytest.raises(InputError, match="known: sum, dim"):
        TabulateJob.from_mapping({"labels": [], "convention": "mean"})
    with pytest.raises(InputError, match="at least one"):
        tabulate([], [tmp_path / "t.md"])


class TestChoice:
    """Of versions by validation: the simplest within one standard error of the best."""

    def table(self, tmp_path, scores, candidates, samples=200):
        rng, files, metrics = np.random.default_rng(0), [], []
        common = np.exp(0.3 * rng.normal(size=(1, samples)))
        for method, level in scores.items():
            errors = {n: common * np.exp(level + 0.02 * rng.normal(size=(2, samples))) for n in ("validation", "test")}
            files.append(write_samples(tmp_path / f"{method}.npz", method, (0, 1), errors))
            rows = [
                (method, method.upper(), f"corrected,{seed},{name},log_mse_sum,{float(np.log(each.mean()))!r}")
                for name, one in errors.items() for seed, each in enumerate(one)
            ]  # fmt: skip
            (tmp_path / method).mkdir()
            metrics.append(write(tmp_path / method / "metrics.csv", rows))
        job = TabulateJob(labels=[], candidates=candidates)
        tabulate(metrics, [tmp_path / "t.md", tmp_path / "t_long.csv"], job, files)
        lines = (tmp_path / "t.md").read_text().partition("| behind |")[2].partition("\n\n")[0].splitlines()
        rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line.startswith("|")][1:]
        assert read_csv(tmp_path / "t_long.csv", TabledMean, "again")  # the report makes the table of it
        return {row[0]: row[1:] for row in rows}

    def test_a_simpler_one_as_good_is_chosen(self, tmp_path):
        found = self.table(tmp_path, {"network": -3.0, "two": -3.0, "simple": -2.9999, "poor": -1.0}, [
            "poor", "simple", "two", "network",
        ])  # fmt: skip
        assert [name for name, row in found.items() if row[3] == "chosen"] == ["SIMPLE"]
        assert found["POOR"][1] == "2.00"

    def test_a_better_network_is_chosen_and_what_does_not_compete_is_not_there(self, tmp_path):
        found = self.table(tmp_path, {"floor": -9.0, "network": -3.0, "simple": -2.5}, ["simple", "network"])
        assert [name for name, row in found.items() if row[3] == "chosen"] == ["NETWORK"]
        assert "FLOOR" not in found

    def test_what_has_no_error_is_as_good_only_where_it_is_not_behind(self, tmp_path):
        """Windows of one stretch say nothing of how far a difference may be by chance: the best is chosen."""
        found = self.table(tmp_path, {"network": -3.0, "simple": -1.0}, ["simple", "network"], samples=1)
        assert [name for name, row in found.items() if row[3] == "chosen"] == ["NETWORK"]
        assert found["SIMPLE"][2] == "–"
