"""The stage validity: does F_a hold where z_e has moved (the paper's assumption A1)?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from torch import Tensor

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.settings import ValidityJob
from expertaug.evaluation.table import DASH, Study, Table, escape
from expertaug.inference.diagnostics.validity import Refit, Validity, along, refit
from expertaug.inference.flow import load
from expertaug.inference.settings import ValiditySettings
from expertaug.models.fit_settings import Refinement
from expertaug.models.store import StoredModel, device_of
from expertaug.settings import given_ranges
from expertaug.trajectories import SetFolder, Trajectories
from expertaug.versions import choose_compared
from expertaug.windows import Windows

SETS = ("train", "iid", "validation", "test")  # of the two in the middle the first that there is
CAPTION = (
    "Windows are fitted by least squares with each trained model, and then F_a is fitted on to them, from what it is. "
    "Explained: share of windows whose χ² per degree of freedom is below the 95 % quantile of the training windows'. "
    "‖ΔF_a‖/‖F_a‖: change of F_a along the windows; where F_a is valid it has no more to learn than on its own "
    "training windows, which are the yardstick. Error of F_a: ‖F_a − truth‖/‖truth‖ on the windows' own states, "
    "median, of simulated data. Holds: range around the training's in which three quarters of windows are explained."
)
DOTTED = {"linewidth": 0.7, "linestyle": ":"}
COLUMNS = {
    "explained": "explained [%]",
    "chi2": "χ²/n, median",
    "change": "‖ΔF_a‖/‖F_a‖ [%]",
    "wrong": "error of F_a [%]",
}


@dataclass(frozen=True)
class OfVersion:
    """What the check of A1 has found of a version.

    Attributes:
        label: that figures print.
        fits: by set.
        first: along the first expert parameter.
        name, unit: of that parameter.
    """

    label: str
    fits: Mapping[str, Refit]
    first: Validity
    name: str
    unit: str


def run_stage(models: Sequence[Path], data: Path, outputs: Sequence[Path], job: ValidityJob) -> None:
    """Stage: write the table of an experiment's check of A1 and draw it along the first expert parameter.

    Arguments:
        models: files of trained models with an interaction model, one of each version.
        data: folder of the sets.
        outputs: any of .csv, .md, .tex, .png and .pdf.
        job: its versions are in the files' order.

    Raises:
        InputError: a file is no such model, or an output's suffix is unknown.
    """
    stored = (load(path, device_of(job.device), job.classes or ()) for path in models)
    validity(stored, SetFolder(data), job).save(outputs)


def validity(models: Iterable[StoredModel], sets: Mapping[str, Trajectories], job: ValidityJob) -> Study:
    """The table of an experiment's check of A1, and its figure along the first expert parameter.

    Arguments:
        models: trained, with an interaction model, one of each version, in the order of the job's; each is needed but
            once.
        sets: train, and of iid, validation and test those that there are; of the test set only the observed windows
            are used, but for the errors of simulated data.

    Raises:
        InputError: nothing says how a model's windows are fitted, or there is no model.
    """
    samples: dict[str, Trajectories] = {}
    trained: tuple[float, float] | None = None
    for name in SETS:
        if name in sets and not (name == "validation" and "iid" in samples):
            whole = sets[name]
            samples[name] = whole.spread(job.validity.samples)
            trained = _true_range(whole) if name == "train" else trained
    rows, says = [], []
    of_versions: dict[str, OfVersion] = {}
    for stored, (version, label, fitting) in zip(models, job.versions, strict=True):
        how = stored.card.refinement or fitting  # of kind alternating, the card says it
        if how is None:
            raise InputError(stored.where, "nothing says how its windows are fitted", "give settings, noise and prior")
        fits = {name: _refit(stored, trajectories, how, job.validity) for name, trajectories in samples.items()}
        parameters = stored.model.system.expert_parameters
        each = {p.name: _along(p.name, k, fits) for k, p in enumerate(parameters)}
        first = parameters[0]
        of_versions[version] = OfVersion(label, fits, each[first.name], first.name, first.unit)
        says += [f"{label}: {verdict.says}." for verdict in each.values()]
        for name, fit in fits.items():
            limit = of_versions[version].first.limit
            rows.append({"method": version, "label": label, "set": name, **_numbers(fit, limit)})
    if not rows:
        raise InputError("models", "none", "give a model file with an interaction model")
    long = pd.DataFrame(rows)
    title = f"{job.of_experiment(job.experiment)}: does F_a hold where z_e has moved?"
    header = ["method", "windows", *COLUMNS.values()]
    cells = [[r["label"], r["set"], *(_text(r[key]) for key in COLUMNS)] for r in rows]
    notes = [f"- {escape(line)}" for line in says]
    table = Table(header, [("", cells)], 2, (), title, CAPTION, "validity", notes=notes)
    return Study(long, [table], lambda: _draw(of_versions, job, title, trained))


def _refit(stored: StoredModel, data: Trajectories, fitting: Refinement, how: ValiditySettings) -> Refit:
    observed = stored.card.observed
    windows = Windows.of(data).until(observed)
    simulated = data.z_a.shape[1] > 0
    truth = (torch.from_numpy(data.z_e), torch.from_numpy(data.z_a)) if simulated else None
    prior = None if fitting.prior is None else given_ranges(fitting.prior)
    return refit(stored, windows, fitting.noise, prior, fitting.settings, how, truth)


def _true_range(train: Trajectories) -> tuple[float, float] | None:
    """Of the first expert parameter in a training set that knows it."""
    values = train.z_e[:, 0] if train.z_e.shape[1] else np.array([np.nan])
    return (float(values.min()), float(values.max())) if np.isfinite(values).all() else None


def _along(name: str, k: int, fits: Mapping[str, Refit]) -> Validity:
    """Of all windows but the training's, by their estimates; those of all seeds count."""
    others = [fit for key, fit in fits.items() if key != "train"]
    z_e, chi2 = (torch.cat(parts).numpy() for parts in zip(*(_flat(fit, k) for fit in others), strict=True))
    of_training = [part.numpy() for part in _flat(fits["train"], k)]
    return along(name, z_e, chi2, *of_training)


def _flat(fit: Refit, k: int) -> tuple[Tensor, Tensor]:
    return fit.z_e[..., k].flatten(), fit.chi2.flatten().nan_to_num(1e30, 1e30)


def _numbers(fit: Refit, limit: float) -> dict[str, float]:
    """Means over seeds; percent where they are shares."""
    wrong = np.nan if fit.wrong is None else 100 * float(fit.wrong[0].median(1).values.mean())
    return {
        "explained": 100 * float((fit.chi2 <= limit).double().mean()),
        "chi2": float(fit.chi2.median(1).values.mean()),
        "chi2_after": float(fit.chi2_after.median(1).values.mean()),
        "change": 100 * float(fit.change().mean()),
        "wrong": wrong,
        "wrong_after": np.nan if fit.wrong is None else 100 * float(fit.wrong[1].median(1).values.mean()),
        "windows": fit.chi2.shape[1],
    }


def _draw(
    of_versions: Mapping[str, OfVersion], job: ValidityJob, title: str, trained: tuple[float, float] | None = None
) -> Figure:
    """χ²/n, and the change of F_a, along the first parameter: a line a version, dotted what the training windows have.

    Arguments:
        trained: the true range of the training set, which is shaded; None: that of its windows' estimates is.
    """
    shown = choose_compared(list(of_versions))
    colours = plotting.colours(shown, dict(job.hues))
    with plotting.use_style():
        figure = plotting.new_figure(3.4)
        left, right = figure.subplots(1, 2)
        ends, handles = [], []
        for version in shown:
            here = of_versions[version]
            along_first = here.first
            middle = 0.5 * (along_first.edges[1:] + along_first.edges[:-1])
            look: plotting.Look = {**plotting.look(version, colours), "linewidth": 1.2}
            handles.append(Line2D([], [], label=here.label, **look))
            change = 100 * _bin(here.fits, along_first.edges)
            usual = 100 * float(here.fits["train"].change().mean())
            for axis, values, level in ((left, along_first.chi2, along_first.limit), (right, change, usual)):
                good = np.isfinite(values)
                axis.plot(middle[good], values[good], **look)
                axis.axhline(level, color=colours[version], **DOTTED)
            ends.append(along_first.trained)
        shaded = trained or (min(low for low, _ in ends), max(high for _, high in ends))
        for axis in (left, right):
            axis.axvspan(*shaded, color="0.92", linewidth=0, zorder=0)
            axis.set_xlabel(plotting.quantity(here.name, here.unit))
            axis.xaxis.set_major_locator(MaxNLocator(5))
            axis.grid(alpha=0.4)
            plotting.plain_log(axis)
        left.set(ylabel="χ²/n of windows, median")
        right.set(ylabel=plotting.text("change of F_a [%]"))
        what = "training range" if trained else "range of the training windows' estimates"
        handles.append(Line2D([], [], color="0.3", label="training windows (left: their 95 % quantile)", **DOTTED))
        plotting.heading(figure, plotting.text(title))
        plotting.legend(figure, [*handles, Patch(color="0.92", label=what)])
    return figure


def _bin(fits: Mapping[str, Refit], edges: np.ndarray) -> np.ndarray:
    """‖ΔF_a‖/‖F_a‖ of the windows of each bin of the first parameter; NaN of an empty one."""
    others = [fit for key, fit in fits.items() if key != "train"]
    z_e = torch.cat([fit.z_e[..., 0].flatten() for fit in others]).numpy()
    squares, changes = (
        torch.cat([getattr(o, key).flatten() for o in others]).numpy() for key in ("squares", "changes")
    )
    place = np.clip(np.searchsorted(edges, z_e, side="right") - 1, 0, len(edges) - 2)
    ratios = np.full(len(edges) - 1, np.nan)
    for k in np.unique(place):
        ratios[k] = np.sqrt(changes[place == k].sum() / max(squares[place == k].sum(), 1e-300))
    return ratios


def _text(value: float) -> str:
    if not np.isfinite(value):
        return DASH
    return f"{value:.3g}" if value < 100 else f"{value:.0f}"
