"""The report page: its numbers come first and from the tables, and nothing is on it without a caption."""

from __future__ import annotations

import re
from html import escape, unescape
from html.parser import HTMLParser
from urllib.parse import quote

import pandas as pd
import pytest
from captions import CAPTIONS
from fake_runs import LABELS, method_of, pairs, write_metrics
from matplotlib.figure import Figure

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.report import tables
from expertaug.evaluation.report.page import run_stage as report
from expertaug.evaluation.settings import ReportExperiment, ReportJob, ShownFile, TabulateJob
from expertaug.evaluation.tabulate import run_stage as tabulate
from expertaug.files import write_json

FIGURES = ("log_mse", "parameter_errors", "parameters", "forecasts", "curves")


class Page(HTMLParser):
    """What a page holds: tags with their attributes, and whether all were closed."""

    VOID = ("meta", "img", "br")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def of(self, tag: str) -> list[dict]:
        return [attributes for name, attributes in self.tags if name == tag]


@pytest.fixture
def run(tmp_path):
    """The results folder of a made-up run, and the job of its report."""
    swing = ReportExperiment(name="swing", labels=pairs()["labels"], title="a swing <b>&", from_s=None)
    outputs = [tmp_path / "tables" / name for name in ("swing.csv", "swing_long.csv", "swing.md")]
    tabulate(write_metrics(tmp_path), outputs, TabulateJob(labels=swing.labels, title=swing.title, from_s=None))
    alarms = pd.DataFrame({"method": ["mean"] * 2, "label": ["Mean"] * 2, "set": ["iid"] * 2, "seed": [0, 1]})
    alarms.assign(auroc=[0.5, 0.7]).to_csv(tmp_path / "tables" / "swing_alarm.csv", index=False)
    numbers = {"value": 2.0, "error": 0.031, "low": 1.95, "high": 2.05, "spread": None, "windows": 9, "groups": 3}
    row = {
        "method": "mean",
        "label": "Mean",
        "parameter": "omega0",
        "unit": "rad/s",
        "of": "all",
        **numbers,
        "told": True,
    }
    pd.DataFrame([row]).to_csv(tmp_path / "tables" / "swing_estimates.csv", index=False)
    shown = [_shown("tables/swing.md", "table", "swing")]
    for name in (*FIGURES, "alarm", "estimates"):
        plotting.save(Figure(figsize=(1, 1)), tmp_path / f"figures/swing_{name}.png")
        shown.append(_shown(f"figures/swing_{name}.png", name, name.replace("_", " ")))
    shown += [_shown(f"tables/swing_{name}.md", name, name) for name in ("alarm", "estimates")]
    (tmp_path / "logs" / "train").mkdir(parents=True)
    (tmp_path / "logs" / "train" / "swing.cost.json").write_text('{"seconds": 61.2, "peak_memory_mb": 300}')
    return tmp_path, ReportJob(
        shown=shown,
        rules=[("simulate_set", "train_seed_group"), ("train_seed_group", "evaluate_seed_group")],
        experiments=[swing],
        files=["my.yaml"],
        preset="corrected",
        seeds=[0, 1, 2],
        device="cpu",
    )


def experiments_of(job: ReportJob, *changed: dict) -> ReportJob:
    """A job of the same, whose one experiment comes once with each of the changes."""
    (swing,) = job.experiments
    return job.model_copy(update={"experiments": [swing.model_copy(update=each) for each in changed]})


@pytest.mark.parametrize("name", ["figures/swing_alarm.png", "tables/swing_long.csv", "tables/swing_alarm.csv"])
def test_a_file_that_a_link_brings_from_elsewhere_is_refused(run, name, tmp_path_factory):
    folder, job = run
    outside = tmp_path_factory.mktemp("own") / "file"
    (folder / name).rename(outside)
    (folder / name).symlink_to(outside)
    with pytest.raises(InputError, match="leads out of"):
        report(folder, folder / "report.html", job)


def _shown(path: str, caption: str, title: str) -> ShownFile:
    wildcards = {"experiment": "swing"}
    return ShownFile(path=path, caption=str(CAPTIONS / f"{caption}.rst"), wildcards=wildcards, title=title)


def test_the_page_has_every_figure_and_table_under_its_caption(run):
    results, job = run
    report(results, results / "report.html", job)
    text = (results / "report.html").read_text()
    page = Page(text)
    assert page.open == [] and len(page.of("table")) == len(page.of("thead")) == 8  # with costs and provenance
    identities = [one["id"] for _, one in page.tags if "id" in one]
    assert len(set(identities)) == len(identities)
    pictures = page.of("img")
    assert len(pictures) == len(FIGURES) + 2
    assert all(one["alt"] and one["aria-describedby"] in identities for one in pictures)
    assert all(one["src"].startswith("data:image/png;base64,") and int(one["width"]) > 9 for one in pictures)
    assert all("scope" in one for one in page.of("th"))
    assert all(one["href"][1:] in identities for one in page.of("a"))
    for name in FIGURES:
        caption = " ".join((CAPTIONS / f"{name}.rst").read_text().split())
        assert caption in " ".join(unescape(text).split())
    for said in ("Hybrid+ is best by validation", "my.yaml", "1 min 01 s", "0.6</td>"):  # the mean of two seeds
        assert said in text


def test_rows_lead_to_their_runs_in_the_dashboard(run):
    results, job = run
    marker = {"enabled": True, "uri": "sqlite:///r/m.db", "experiment": "e", "experiments": {"swing": "3"}}
    write_json(results / "mlflow" / "tracking.json", marker)
    report(results, results / "report.html", job)
    text = (results / "report.html").read_text()
    page = Page(text)
    assert page.open == [] and "mlflow server --backend-store-uri sqlite:///r/m.db" in text
    start = "http://127.0.0.1:5000/#/experiments/3/runs?workflowType=machine_learning&searchFilter=tags.method%20%3D%20"
    links = [one["href"] for one in page.of("a") if one["href"].startswith("http")]
    assert {link.removeprefix(start) for link in links} == {f"%27{quote(method_of(label))}%27" for label in LABELS}
    address = escape(f"{start}%27{quote(method_of('Hybrid+'))}%27")
    assert text.count(f'<a href="{address}">Hybrid+</a>') >= 2  # in the headline and among the metrics
    write_json(results / "mlflow" / "tracking.json", {"enabled": False})
    report(results, results / "report.html", job)
    assert "http://" not in (results / "report.html").read_text()


def test_what_a_laboratory_asks_comes_first(run):
    """The estimates, to two digits of their errors, and which forecasts to trust, before the scores of methods."""
    results, job = run
    report(results, results / "report.html", job)
    text = (results / "report.html").read_text()
    titles = re.findall(r"<b>(?:Figure|Table) \d+\. ([^<]*)\.</b>", text)
    assert titles[:6] == ["Headline numbers", "Estimates", "Estimates", "Alarm", "Alarm", "Metrics"]
    assert "<td>2.000</td><td>0.031</td><td>[1.950, 2.050]</td>" in text


def test_what_has_nothing_to_show_is_left_out_and_long_tables_are_folded(run):
    """A figure of words alone and a table without rows; of 41 rows the first line alone is read at once."""
    results, job = run
    note = plotting.note("the true parameters are not known")
    plotting.save_all({results / "figures" / "swing_parameter_errors.png": note})
    estimates = pd.read_csv(results / "tables" / "swing_estimates.csv")
    pd.concat([estimates] * 41).to_csv(results / "tables" / "swing_estimates.csv", index=False)
    alarms = pd.read_csv(results / "tables" / "swing_alarm.csv")
    alarms[:0].to_csv(results / "tables" / "swing_alarm.csv", index=False)
    report(results, results / "report.html", job)
    text = (results / "report.html").read_text()
    assert ". Parameter errors" not in text and ". Log mse" in text
    assert "Estimates (41 rows)" in text and "(0 rows)" not in text


def test_headline_columns_are_called_as_the_experiments_call_their_sets(run):
    results, job = run
    titles = {"set_titles": {"test": "test (other trajectories)"}}
    report(results, results / "report.html", experiments_of(job, titles))
    text = (results / "report.html").read_text()
    assert "test (other trajectories)" in text and "OOD)</th>" not in text


def test_a_remark_that_all_titles_end_in_is_the_banner(run):
    results, job = run
    first, other = {"title": "a swing (toy run: no numbers)"}, {"title": "another"}
    for experiments, banner in (([first], True), ([first, other], False)):
        report(results, results / "report.html", experiments_of(job, *experiments))
        text = (results / "report.html").read_text()
        assert ('<p class="notice" role="note">Toy run: no numbers</p>' in text) == banner
        assert ("<h1>Results of a swing</h1>" in text) == banner
        Page(text)


def test_names_are_escaped(run):
    results, job = run
    report(results, results / "report.html", job)
    text = (results / "report.html").read_text()
    assert "swing &lt;b&gt;&amp;" in text and "<b>&" not in text


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("tables/swing_long.csv", "no such file; run the workflow to its end first"),
        ("tables/swing_alarm.csv", "no such file; run the workflow to its end first"),
        ("figures/swing_curves.png", "no such file; run the workflow to its end first"),
    ],
)
def test_a_missing_file_is_one_clear_line_and_no_page(run, file, said):
    results, job = run
    (results / file).unlink()
    with pytest.raises(InputError, match=f"{file}: {said}"):
        report(results, results / "report.html", job)
    assert not (results / "report.html").exists()


def test_the_main_table_is_that_of_the_csv_file(run):
    results, job = run
    long = tables.read_long(results / "tables/swing_long.csv")
    found = tables.main(long, experiments_of(job, {"known_form": [method_of("ML only")]}).experiments[0])
    (_, rivals), (title, known) = found.html_parts
    assert title == "F_a of known form, which does not compete" and [row[0] for row in known] == ["ML only"]
    one = next(one for one in long if (one.label, one.set, one.metric) == ("Hybrid", "test", "log_mse_sum"))
    row = next(row for row in rivals if row[0] == "Hybrid")
    over = [""] * found.names + [title for title, width in found.spans for _ in range(width)]
    column = next(k for k, (above, name) in enumerate(zip(over, found.head, strict=True)) if "test" in above)
    assert found.head[column] == "log-MSE" and row[1] == "3"
    assert row[column] == f"{one.mean:.2f} ± {one.std:.2f}".replace("-", "−")
