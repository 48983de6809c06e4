"""What the page shows of a run: its figures and tables with their captions, its numbers, costs and provenance, as its
results folder has them."""

from __future__ import annotations

import base64
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace

import jinja2

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation import costs, run_record
from expertaug.evaluation.costs import Cost
from expertaug.evaluation.report import tables
from expertaug.evaluation.report.tables import Numbers
from expertaug.evaluation.run_record import RunRecord
from expertaug.evaluation.settings import ReportJob, ShownFile
from expertaug.evaluation.summary import TabledMean
from expertaug.files import check_inside
from expertaug.tracking import provenance
from expertaug.tracking.settings import Tracking, tracking_of_run

PNG = b"\x89PNG\r\n\x1a\n"
SCALE = 130 / plotting.DPI  # of pixels on the page to those of a figure: its letters are as large as the text's
ESTIMATES = "estimates"


@dataclass(frozen=True)
class Picture:
    """A figure as a data URI, and its width and height on the page in px."""

    uri: str
    width: int
    height: int

    @classmethod
    def of(cls, content: bytes, where: object = "figure") -> Picture:
        """A PNG file's content.

        Raises:
            InputError: it is none.
        """
        if content[:8] != PNG or len(content) < 24:
            raise InputError(where, "is no PNG file", "delete it and run the workflow")
        width, height = (round(pixels * SCALE) for pixels in struct.unpack(">II", content[16:24]))
        return cls(f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}", width, height)


@dataclass(frozen=True)
class Shown:
    """A figure or a table that is shown.

    Attributes:
        path: in the results folder, ``figures/….png``, or ``….md`` of a table, whose numbers are in the CSV beside it.
        caption: in full.
        wildcards: of the file's name, as the rule has them.
        title: a few words.
        picture: of a figure; None of one that says only why there is nothing to draw (:func:`expertaug.plotting.note`).
        numbers: of a table; None of an experiment's own, which is made of its long table.
    """

    path: str
    caption: str
    wildcards: Mapping[str, str]
    title: str
    picture: Picture | None = None
    numbers: Numbers | None = None

    @property
    def experiment(self) -> str | None:
        """The experiment that it is of; None for what is of all or of recordings."""
        return self.wildcards.get("experiment")

    @property
    def of_recordings(self) -> bool:
        return self.experiment is None and self.path.startswith("recordings/")

    @property
    def is_figure(self) -> bool:
        return self.path.endswith(".png")

    @property
    def stem(self) -> str:
        """The file's name without its end."""
        return Path(self.path).stem

    @property
    def csv(self) -> str:
        """The file of a table's numbers, in the results folder."""
        return str(Path(self.path).with_suffix(".csv"))


@dataclass(frozen=True)
class Results:
    """All that the page says of a run.

    Attributes:
        long: the long table of each experiment (:mod:`expertaug.evaluation.tabulate`), in the order of the job's.
        shown: figures and tables, in the order of the job's.
        record: what computed the numbers.
        costs: what each job took.
        tracking: the store that the dashboard shows; None where the run has none.
        revision: of the code that makes the page; None outside of a git checkout.
    """

    long: Sequence[Sequence[TabledMean]]
    shown: Sequence[Shown]
    record: RunRecord
    costs: Mapping[str, Cost] = field(default_factory=dict)
    tracking: Tracking | None = None
    revision: str | None = None


def read_results(folder: Path, job: ReportJob) -> Results:
    """What a finished run's results folder has of what a job shows.

    Raises:
        InputError: a table, a figure or a caption is missing or broken.
    """
    named = [experiment.name for experiment in job.experiments]
    long = [tables.read_long(check_inside(folder / f"tables/{name}_long.csv", folder)) for name in named]
    shown = [
        _read(file, folder, job.preset) for file in job.shown if file.wildcards.get("experiment") in {*named, None}
    ]
    measured = costs.of_run(folder / "logs")
    record = run_record.of_run(folder, measured)
    return Results(long, shown, record, measured, tracking_of_run(folder), provenance.revision())


def _read(file: ShownFile, folder: Path, preset: str) -> Shown:
    """A figure or a table of the results folder."""
    shown = Shown(file.path, caption(file, preset), file.wildcards, file.title)
    if shown.stem == shown.experiment:
        return shown
    if shown.is_figure:
        return replace(shown, picture=_read_picture(check_inside(folder / shown.path, folder)))
    return replace(shown, numbers=_read_numbers(shown, check_inside(folder / shown.csv, folder)))


def _read_picture(path: Path) -> Picture | None:
    """A figure; None of one that says only why there is nothing to draw."""
    if not path.is_file():
        raise InputError(path, "no such file", "run the workflow to its end first")
    content = path.read_bytes()
    return None if f"Comment\0{plotting.NOTE}".encode() in content[:4096] else Picture.of(content, path)


def _read_numbers(shown: Shown, path: Path) -> Numbers:
    if shown.stem == "published":
        return tables.read_published(path)
    if shown.of_recordings:
        return tables.read_recordings(path)
    if shown.experiment is not None and shown.stem == f"{shown.experiment}_{ESTIMATES}":
        return tables.read_stated(path)
    return tables.read_numbers(path)


def caption(file: ShownFile, preset: str) -> str:
    """A file's caption: a text in the words of Snakemake's reports.

    Raises:
        InputError: it is missing, or has a word that nothing stands for.
    """
    words = SimpleNamespace(wildcards=SimpleNamespace(**file.wildcards), config={"preset": preset})
    try:
        source = Path(file.caption).read_text(encoding="utf-8")
        content = jinja2.Template(source, undefined=jinja2.StrictUndefined).render(snakemake=words)
    except (OSError, jinja2.TemplateError) as error:
        raise InputError(file.caption, f"no caption for {file.path} ({error})", "give the workflow's own") from error
    return " ".join(content.split())
