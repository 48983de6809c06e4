"""The stage report: tables, figures, costs and provenance of a run on one page."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import jinja2

from expertaug.evaluation import run_record
from expertaug.evaluation.report import headline, tables
from expertaug.evaluation.report.graph import drawing
from expertaug.evaluation.report.links import Dashboard, Links
from expertaug.evaluation.report.shown import ESTIMATES, Picture, Results, Shown, read_results
from expertaug.evaluation.settings import Reading, ReportExperiment, ReportJob
from expertaug.evaluation.summary import TabledMean
from expertaug.evaluation.table import STAR, Table
from expertaug.evaluation.tabulate import CHOICE, GAINS, WORST
from expertaug.files import write_text

TEMPLATE = Path(__file__).with_name("page.html")
RECORDINGS, OVERALL = "Recordings", "All experiments"
LONG = 40  # rows of a table that is folded
FIRST = (ESTIMATES, "alarm")  # of an experiment: what a laboratory asks, before the scores of methods


@dataclass(frozen=True)
class Block:
    """A figure or a table with its number and its caption.

    Attributes:
        name: "Figure 3".
        title: a few words.
        caption: in full.
        picture: a figure's.
        table: a table's cells.
        folded: whether it is shown only when it is asked for.
        links: where the runs behind its rows are.
    """

    name: str
    title: str
    caption: str
    picture: Picture | None = None
    table: Table | None = None
    folded: bool = False
    links: Links = field(default_factory=dict)


class Numbering:
    """Gives figures and tables their numbers, in the order of the page."""

    def __init__(self) -> None:
        self._next = {"Figure": count(1), "Table": count(1)}

    def figure(self, title: str, caption: str, picture: Picture, folded: bool = False) -> Block:
        return Block(f"Figure {next(self._next['Figure'])}", title, caption, picture, folded=folded)

    def table(self, title: str, caption: str, table: Table, folded: bool = False, links: Links | None = None) -> Block:
        name = f"Table {next(self._next['Table'])}"
        return Block(name, title, caption, table=table, folded=folded, links=links or {})


def run_stage(results: Path, output: Path, job: ReportJob) -> None:
    """Stage: write the page, one HTML file that needs no other.

    Arguments:
        results: the results folder of a finished run.
        output: the file.

    Raises:
        InputError: a table, a figure or a caption is missing or broken.
    """
    write_text(output, report(read_results(Path(results), job), job))


def report(results: Results, job: ReportJob) -> str:
    """The page, one HTML text that needs no other.

    Arguments:
        results: what it shows; the job's files are not read.
    """
    numbers, shown = Numbering(), results.shown
    experiments = list(zip(results.long, job.experiments, strict=True))
    dashboard = Dashboard(results.tracking)
    table = headline.table(experiments)
    links = dashboard.of_several(
        table, {headline.part(experiment): (experiment.name, long) for long, experiment in experiments}
    )
    first = numbers.table("Headline numbers", headline.CAPTION, table, links=links)
    of_all = [file for file in shown if file.experiment is None and not file.of_recordings]
    sections = [(OVERALL, _blocks(numbers, of_all, job))]
    for long, experiment in experiments:
        own = [s for s in shown if s.experiment == experiment.name and s.stem != experiment.name]
        caption = next((s.caption for s in shown if s.stem == experiment.name), "")
        asked = [s for name in FIRST for s in own if s.stem == f"{experiment.name}_{name}"]
        blocks = _blocks(numbers, asked, job, experiment, folded=False)
        blocks += _of_experiment(numbers, long, experiment, caption, dashboard)
        blocks += _blocks(numbers, [s for s in own if s not in asked], job, experiment)
        sections.append((experiment.of_experiment(experiment.name), blocks))
    sections.append((RECORDINGS, _blocks(numbers, [s for s in shown if s.of_recordings], job)))
    titles, notice = _without_notice([experiment.of_experiment(experiment.name) for _, experiment in experiments])
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        title=f"Results of {', '.join(titles)}",
        notice=notice,
        sentences=[headline.sentence(*part) for part in experiments],
        headline=first,
        linked=bool(first.links),
        served=dashboard.command,
        sections=[(title, blocks) for title, blocks in sections if blocks],
        costs=run_record.costs_table(results.costs) if results.costs else None,
        provenance=run_record.provenance_table(results.record, job, results.revision),
        graph=drawing(job.rules),
    )


def _without_notice(titles: Sequence[str]) -> tuple[list[str], str]:
    """Titles without the remark in brackets that all of them end in, as of a toy run, and that remark; it is the page's
    banner."""
    ends = [re.fullmatch(r"(.+?) \((.+)\)", title) for title in titles]
    remarks = {end and end[2] for end in ends}
    if len(remarks) != 1 or None in remarks:
        return list(titles), ""
    return [end[1] for end in ends if end], remarks.pop() or ""


def _of_experiment(
    numbers: Numbering, long: Sequence[TabledMean], experiment: ReportExperiment, caption: str, dashboard: Dashboard
) -> list[Block]:
    """Tables of an experiment: its metrics, the gains of augmented versions, and the other metrics."""
    shown = [("Metrics", caption, tables.main(long, experiment))]
    if choice := tables.choice(long, experiment):
        shown.append(("Choice", CHOICE, choice))
    if gained := tables.gains(long, experiment):
        shown.append(("Gains", f"{GAINS.partition(' bold')[0]} {STAR}: significant.", gained))
    if worst := tables.worst_seeds(long, experiment):
        shown.append(("Worst seeds", WORST, worst))
    blocks = [numbers.table(*block, links=dashboard.of(block[2], experiment.name, long)) for block in shown]
    more = tables.further(long, experiment)
    if more.size:
        said = f"All other metrics, of the same runs as {blocks[0].name}."
        blocks.append(numbers.table("Further metrics", said, more, folded=True))
    return blocks


def _blocks(
    numbers: Numbering,
    shown: Sequence[Shown],
    job: ReportJob,
    experiment: ReportExperiment | None = None,
    folded: bool = True,
) -> list[Block]:
    """Figures, each with its table below it, folded or not, and then tables that have no figure.  What has nothing to
    show, no row or only words in place of a picture, is left out."""
    blocks: list[Block | None] = []
    of_figures = {file.stem: file for file in shown if not file.is_figure}
    for file in sorted(shown, key=lambda file: not file.is_figure):
        if file.is_figure and file.picture is None:
            if file.stem in of_figures:
                blocks.append(_table(numbers, of_figures[file.stem], job, file.caption, experiment, folded))
        elif file.picture is not None:
            figure = numbers.figure(file.title, file.caption, file.picture, "recording" in file.wildcards)
            blocks.append(figure)
            if file.stem in of_figures:
                said = f"The numbers of {figure.name}, means over seeds; every digit is in {of_figures[file.stem].csv}."
                blocks.append(_table(numbers, of_figures[file.stem], job, said, experiment, folded))
        elif file.stem not in {block.stem for block in shown if block.is_figure}:
            blocks.append(_table(numbers, file, job, file.caption, experiment))
    return [block for block in blocks if block is not None]


def _table(
    numbers: Numbering,
    file: Shown,
    job: ReportJob,
    caption: str,
    experiment: ReportExperiment | None,
    folded: bool = False,
) -> Block | None:
    """A file's table, folded if it is long; None if it has no row."""
    table = file.numbers.table(experiment or Reading(), job) if file.numbers is not None else None
    if table is None or not table.size:
        return None
    if isinstance(file.numbers, tables.Published):
        caption += " Methods that were not run are left out."
    return numbers.table(file.title, caption, table, folded or table.size > LONG)
