"""The stage equation: which terms does the expert lack?"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from expertaug.equation.result import Coefficient, Found
from expertaug.equation.search import Options, Search
from expertaug.errors import InputError
from expertaug.evaluation.settings import EquationJob
from expertaug.evaluation.table import DASH, Study, Table, escape
from expertaug.inference.flow import load
from expertaug.inference.least_squares import refine_by
from expertaug.models.store import StoredModel, device_of
from expertaug.models.terms import Term, round_to_error
from expertaug.rows import frame
from expertaug.trajectories import SetFolder, Trajectories

CAPTION = (
    "Terms that the expert lacks: proposed by the windows' normal equations at the expert and, of a method with an "
    "F_a, by its values; refitted through the solver with the expert's constants; chosen by forecasts of the "
    "validation windows, the shortest formula within one standard error of the best. ±: standard error. Spread: of "
    "coefficients that each window has its own. Validation: the same coefficient refitted to the validation windows; "
    "one that moves by more than three standard errors is a correction, not a law."
)
SCORES = "Forecasts of the validation windows after the observed one: log-MSE, the lower the better."
EMPTY = "No term: the expert alone forecasts the validation windows as well."


def run_stage(models: Sequence[Path], data: Path, outputs: Sequence[Path], job: EquationJob) -> None:
    """Stage: write the table of the terms that an experiment's expert lacks.

    Arguments:
        models: files of models with an expert, one of each version.
        data: folder of the sets, of which training and validation are used.
        outputs: any of .csv, .md and .tex.
        job: its versions are in the files' order.

    Raises:
        InputError: a file is no such model, windows end where forecasts begin, or an output's suffix is unknown.
    """
    stored = (load(path, device_of(job.device), job.classes or ()) for path in models)
    equations(stored, SetFolder(data), job).save(outputs)


def equations(models: Iterable[StoredModel], sets: Mapping[str, Trajectories], job: EquationJob) -> Study:
    """The table of the terms that an experiment's expert lacks.

    Arguments:
        models: with an expert, one of each version, in the order of the job's; each is needed but once.
        sets: train and validation.

    Raises:
        InputError: nothing says how a model's windows are fitted, or windows end where forecasts begin.
    """
    samples = [sets[name].spread(job.equation.samples) for name in ("train", "validation")]
    results = {}
    for stored, version in zip(models, job.versions, strict=True):
        how = stored.card.refinement or version.refinement  # what fits windows says it on its card
        if how is None:
            raise InputError(stored.where, "nothing says how its windows are fitted", "give settings, noise and prior")
        predictor = refine_by(stored, how) if stored.kind.fits_windows else stored.model
        results[version.version] = Search(stored, predictor, how, *samples).run(_options(job, stored))
    labels = {version.version: version.label for version in job.versions}
    rows = [row for version, result in results.items() for row in _rows(version, labels[version], result)]
    title = f"{job.of_experiment(job.experiment)}: what does the expert lack?"
    head = ["method", "term", "coefficient", "±", "spread", "validation", "verdict"]
    terms = [[labels[v], str(c.term), *_numbers(c)] for v, result in results.items() for c in result.coefficients]
    scores = [
        [labels[v], row.name, row.terms, f"{row.log_mse:.2f}".replace("-", "−")]
        for v, result in results.items()
        for row in result.rows
    ]
    notes = [f"- {escape(line)}" for version, result in results.items() for line in _notes(labels[version], result)]
    tables = [
        Table(head, [("", terms)], 2, (), title, CAPTION, "equation", notes=notes, empty=EMPTY),
        Table(["method", "forecast by", "terms", "log-MSE"], [("", scores)], 3, (), "", SCORES),
    ]
    return Study(frame(EquationRow, rows), tables)


def _options(job: EquationJob, stored: StoredModel) -> Options:
    how = job.equation
    extra, hand = (tuple(Term.of(text) for text in texts) for texts in (how.extra, how.by_hand))
    components = None if how.components is None else tuple(how.components)
    return Options(extra, None, hand, components, how.kinematics, how.by_parameters, how.most_terms)


@dataclass(frozen=True)
class EquationRow:
    """A row of the CSV.

    Attributes:
        method, label: of the version.
        what: ``coefficient`` of a term, ``constant`` that all windows share, or whose forecasts are scored.
        formula: the term, the constant's name, or the terms that forecast.
        log_mse: of validation forecasts.
        value, error, spread, validation, validation_error, verdict, survival: as of a
            :class:`~expertaug.equation.result.Coefficient`.
    """

    method: str
    label: str
    what: str
    formula: str
    log_mse: float = np.nan
    value: float = np.nan
    error: float = np.nan
    spread: float = np.nan
    validation: float = np.nan
    validation_error: float = np.nan
    verdict: str = ""
    survival: float = np.nan


def _rows(version: str, label: str, result: Found) -> Iterator[EquationRow]:
    for row in result.rows:
        yield EquationRow(version, label, row.name, row.terms, row.log_mse)
    for c in result.coefficients:
        numbers = (c.value, c.error, c.spread, c.validation, c.validation_error, c.verdict, c.survival)
        yield EquationRow(version, label, "coefficient", str(c.term), np.nan, *numbers)
    for name, (value, error) in result.constants.items():
        yield EquationRow(version, label, "constant", name, value=value, error=error)


def _numbers(c: Coefficient) -> list[str]:
    each = [(c.value, c.error), (c.error, c.error), (c.spread, c.error), (c.validation, c.validation_error)]
    texts = [round_to_error(value, error).replace("-", "−") if np.isfinite(value) else DASH for value, error in each]
    return [*texts, c.verdict]


def _notes(label: str, result: Found) -> Iterator[str]:
    if np.isfinite(result.explained):
        yield (
            f"{label}: the terms explain {100 * result.explained:.0f} % of F_a's square "
            "at the training windows' states."
        )
    if result.ties:
        yield f"{label}: as good within one standard error: {'; '.join(result.ties)}."
