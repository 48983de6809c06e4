"""The stage coverage: whether intervals of z_e and bands of forecasts hold, of every version that has any, on the
version's own windows and on every set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from expertaug import plotting
from expertaug.evaluation.diagnostic_figures import draw_calibration
from expertaug.evaluation.forecasts import OWN
from expertaug.evaluation.settings import Titles, WindowStudyJob
from expertaug.evaluation.table import DASH, Study, Table
from expertaug.evaluation.windows import Drawn, VersionWindows, read_windows
from expertaug.inference.diagnostics.calibration import TABLE_LEVELS, Calibration, area_to_curve, interval_coverage
from expertaug.versions import Version

EMPTY = "No version has intervals of parameters that are known (those of forecasts: see the experiment's table)."
FORECAST = "forecast"  # in the place of a parameter
OWN_TITLE = "the model's own windows"
CAPTION = (
    "Share of windows whose true expert parameter lies in the central 50 % and 90 % intervals of its estimated "
    "distribution, over all windows and seeds; the nominal share is right. Rows called forecast: share of the times "
    "and quantities of the forecast at which the data lie in the central intervals of forecasts drawn from that "
    "distribution, with the data's noise. The model's own windows are made by the model itself over p⁺: there alone "
    "any deviation is an error of inference. Seeds pooled: intervals of all seeds' draws together, an ensemble. "
    "Posteriors are a flow's, a hybrid-VAE's Gaussian, or, of least squares and refined versions, Laplace's "
    "approximation, with the noise that the fits assume: where the data have none it is too wide. ATC: area between "
    "TARP's expected coverage and the diagonal, 0 where right, above 0 too wide, below 0 too narrow. Versions that "
    "estimate a point alone are left out."
)


def coverage(forecasts: Sequence[Path], outputs: Sequence[Path], job: WindowStudyJob) -> None:
    """Write the table of an experiment's coverage and draw the calibration of one version.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds.
        outputs: any of .csv, .md, .tex, .png and .pdf; where no version has intervals they say so.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    versions, labels = read_windows(forecasts), job.label_of
    known = [v for v in labels if v in versions and any(s.drawn for s in versions[v].sets.values())]
    rows = [row for v in known for row in _rows(v, labels[v], versions[v])]
    columns = [
        "method",
        "label",
        "set",
        "parameter",
        "pooled",
        *(f"coverage_{round(100 * x)}" for x in TABLE_LEVELS),
        "atc",
        "windows",
    ]
    long = pd.DataFrame(rows, columns=columns)
    title = f"{job.of_experiment(next(iter(versions.values())).experiment)}: coverage of intervals"
    Study(long, [_table(long, job, title)], lambda: _draw({v: versions[v] for v in known}, job, title)).save(outputs)


def _draw(versions: Mapping[str, VersionWindows], job: WindowStudyJob, title: str) -> Figure:
    """The calibration of the first flow, or of the first version that has a distribution."""
    if not versions:
        return plotting.note(EMPTY)
    shown = next((v for v in versions if Version.parse(v).is_flow), next(iter(versions)))
    version = versions[shown]
    drawn = {OWN_TITLE: version.own, **{job.of_set(name): version.sets[name].drawn for name in version.judged}}
    kinds = {name: _calibration(one, 0) for name, one in drawn.items() if one is not None}
    return draw_calibration(kinds, version.parameters, f"{title}, {job.label_of[shown]}, seed {version.seeds[0]}")


def _calibration(drawn: Drawn, seed: int) -> Calibration:
    return Calibration(drawn.count, drawn.ranks[seed], drawn.tarp[seed])


def _rows(version: str, label: str, of: VersionWindows) -> list[dict]:
    found = []
    for name, one in {OWN: of.own, **{name: s.drawn for name, s in of.sets.items()}}.items():
        if one is None or name == "train":
            continue
        identity = {"method": version, "label": label, "set": name}
        of_seeds = [_calibration(one, k) for k in range(len(of.seeds))]
        found += [identity | row for row in _of_parameters(of.parameters, of_seeds)]
        if name != OWN and (one.ranks != one.ranks[:1]).any():  # each seed's own windows are others
            found += [identity | row | {"pooled": True} for row in _of_parameters(of.parameters, [_pooled(one)])]
        if one.inside is not None:
            shares = _shares(one.inside.mean((0, 1)))
            row = {"parameter": FORECAST, "pooled": False, **shares, "atc": np.nan, "windows": one.inside.shape[1]}
            found.append(identity | row)
    return found


def _pooled(drawn: Drawn) -> Calibration:
    """Of the draws of all seeds together: how many lie below the truth is the sum of how many do of each seed."""
    return Calibration(drawn.count * len(drawn.ranks), drawn.ranks.sum(0), drawn.tarp.sum(0))


def _of_parameters(names: Sequence[str], of_seeds: Sequence[Calibration]) -> list[dict]:
    each = [interval_coverage(c.marginal, c.draws, TABLE_LEVELS).share for c in of_seeds]
    atc = float(np.mean([area_to_curve(c.tarp, c.draws) for c in of_seeds]))
    rest = {"pooled": False, "atc": atc, "windows": len(of_seeds[0].tarp)}
    return [{"parameter": p, **_shares(share), **rest} for p, share in zip(names, np.mean(each, axis=0).T, strict=True)]


def _shares(share: np.ndarray) -> dict[str, float]:
    return {f"coverage_{round(100 * x)}": float(share[j]) for j, x in enumerate(TABLE_LEVELS)}


def _table(long: pd.DataFrame, titles: Titles, title: str) -> Table:
    header = ["method", "set", "parameter", *(f"in {100 * x:.0f} % [%]" for x in TABLE_LEVELS), "ATC"]
    rows = []
    for _, row in long.iterrows():
        shares = [f"{100 * row[f'coverage_{round(100 * x)}']:.1f}" for x in TABLE_LEVELS]
        atc = f"{row['atc']:.3f}".replace("-", "−") if np.isfinite(row["atc"]) else DASH
        name = OWN_TITLE if row["set"] == OWN else titles.of_set(row["set"])
        parameter = f"{row['parameter']}, seeds pooled" if row["pooled"] else row["parameter"]
        rows.append([row["label"], name, parameter, *shares, atc])
    return Table(header, [("", rows)], 3, (), title, CAPTION, "coverage", empty=EMPTY)
