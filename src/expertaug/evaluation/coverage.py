"""The stage coverage: whether intervals of z_e hold, of every version that has any, on every set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from expertaug import plotting
from expertaug.evaluation.diagnostic_figures import draw_calibration
from expertaug.evaluation.formats import DASH, write_study
from expertaug.evaluation.summary import experiment_title, set_title
from expertaug.evaluation.windows import Version, WindowSet, experiment_of, read_windows
from expertaug.inference.calibration import Calibration
from expertaug.inference.coverage import area_to_curve, interval_coverage
from expertaug.labels import is_flow

LEVELS = (0.5, 0.9)
EMPTY = "No version has intervals."
CAPTION = (
    "Share of windows whose true expert parameter lies in the central 50 % and 90 % intervals of its estimated "
    "distribution, over all windows and seeds; the nominal share is right. Posteriors are a flow's, a hybrid-VAE's "
    "Gaussian, or, of least squares and refined versions, Laplace's approximation. ATC: area between TARP's expected "
    "coverage and the diagonal, 0 where right, above 0 too wide, below 0 too narrow. Versions that estimate a point "
    "alone are left out."
)


def coverage(forecasts: Sequence[Path], outputs: Sequence[Path], settings: Mapping) -> None:
    """Write the table of an experiment's coverage and draw the calibration of one version.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds.
        outputs: any of .csv, .md, .tex, .png and .pdf; where no version has intervals they say so.
        settings: {labels, set_titles, title}; ``labels`` has pairs of a version and its printed label, in order.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    versions, labels = read_windows(forecasts), dict(settings["labels"])
    known = [v for v in labels if v in versions and any(s.ranks is not None for s in versions[v].sets.values())]
    rows = [row for v in known for row in _rows(v, labels[v], versions[v])]
    columns = ["method", "label", "set", "parameter", *(f"coverage_{round(100 * x)}" for x in LEVELS), "atc", "windows"]
    long = pd.DataFrame(rows, columns=columns)
    title = f"{experiment_title(experiment_of(forecasts), settings)}: coverage of z_e"
    drawn = write_study(outputs, long, (*_table(long, settings), 3), CAPTION, "coverage", title, EMPTY)
    if not drawn:
        return
    if not known:
        plotting.save_note(EMPTY, drawn)
        return
    shown = next((v for v in known if is_flow(v)), known[0])
    one = versions[shown]
    kinds = {set_title(name, settings): _calibration(one.sets[name], 0) for name in one.judged}
    with plotting.styled():
        figure = draw_calibration(kinds, one.parameters, f"{title}, {labels[shown]}, seed {one.seeds[0]}")
        plotting.save(figure, drawn)


def _calibration(windows: WindowSet, seed: int) -> Calibration:
    assert windows.ranks is not None and windows.tarp is not None
    return Calibration(windows.draws, windows.ranks[seed], windows.tarp[seed])


def _rows(version: str, label: str, of: Version) -> list[dict]:
    found = []
    for name, one in of.sets.items():
        if one.ranks is None or name == "train":
            continue
        of_seeds = [_calibration(one, k) for k in range(len(of.seeds))]
        each = np.mean([interval_coverage(c.marginal, one.draws, LEVELS).share for c in of_seeds], axis=0)
        atc = float(np.mean([area_to_curve(c.tarp, one.draws) for c in of_seeds]))
        for p, parameter in enumerate(of.parameters):
            shares = {f"coverage_{round(100 * x)}": float(each[j, p]) for j, x in enumerate(LEVELS)}
            identity = {"method": version, "label": label, "set": name, "parameter": parameter}
            found.append({**identity, **shares, "atc": atc, "windows": len(one.z_e)})
    return found


def _table(long: pd.DataFrame, settings: Mapping) -> tuple[list[str], list[list[str]]]:
    header = ["method", "set", "parameter", *(f"in {100 * x:.0f} % [%]" for x in LEVELS), "ATC"]
    rows = []
    for _, row in long.iterrows():
        shares = [f"{100 * row[f'coverage_{round(100 * x)}']:.1f}" for x in LEVELS]
        atc = f"{row['atc']:.3f}".replace("-", "−") if np.isfinite(row["atc"]) else DASH
        rows.append([row["label"], set_title(row["set"], settings), row["parameter"], *shares, atc])
    return header, rows
