"""The stage coverage: whether intervals of z_e and bands of forecasts hold, of every version that has any, on the
version's own windows and on every set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from expertaug import plotting
from expertaug.evaluation.diagnostic_figures import draw_calibration
from expertaug.evaluation.forecasts import OWN
from expertaug.evaluation.settings import Titles, WindowStudyJob
from expertaug.evaluation.table import DASH, Study, Table
from expertaug.evaluation.windows import Drawn, VersionWindows, read_windows
from expertaug.inference.diagnostics.calibration import TABLE_LEVELS, Calibration, area_to_curve, interval_coverage
from expertaug.rows import frame
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


@dataclass(frozen=True)
class Covered:
    """How often intervals of a version hold on a set.

    Attributes:
        method, label, set: of which version and set; the set may be the model's own windows.
        parameter: or forecasts.
        pooled: whether the draws of all seeds are taken together.
        coverage_50, coverage_90: shares in the central intervals of these levels.
        atc: area between TARP's expected coverage and the diagonal; NaN of forecasts.
        windows: their number.
    """

    method: str
    label: str
    set: str
    parameter: str
    pooled: bool
    coverage_50: float
    coverage_90: float
    atc: float
    windows: int

    @property
    def shares(self) -> list[float]:
        """By level, as :data:`TABLE_LEVELS`."""
        return [self.coverage_50, self.coverage_90]


def coverage(forecasts: Sequence[Path], outputs: Sequence[Path], job: WindowStudyJob) -> None:
    """Write the table of an experiment's coverage and draw the calibration of one version.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds.
        outputs: any of .csv, .md, .tex, .png and .pdf; where no version has intervals they say so.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    versions, labels = read_windows(forecasts), job.label_of
    drawn = {v: versions[v] for v in labels if v in versions and any(s.drawn for s in versions[v].sets.values())}
    rows = [row for v, version in drawn.items() for row in _rows(v, labels[v], version)]
    title = f"{job.of_experiment(next(iter(versions.values())).experiment)}: coverage of intervals"
    Study(frame(Covered, rows), [_table(rows, job, title)], lambda: _draw(drawn, job, title)).save(outputs)


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


def _rows(version: str, label: str, of: VersionWindows) -> list[Covered]:
    rows = []
    for name, drawn in {OWN: of.own, **{name: s.drawn for name, s in of.sets.items()}}.items():
        if drawn is None or name == "train":
            continue
        whose = (version, label, name)
        of_seeds = [_calibration(drawn, k) for k in range(len(of.seeds))]
        rows += _of_parameters(whose, of.parameters, of_seeds)
        if name != OWN and (drawn.ranks != drawn.ranks[:1]).any():  # each seed's own windows are others
            rows += _of_parameters(whose, of.parameters, [_pooled(drawn)], pooled=True)
        if drawn.inside is not None:
            shares = map(float, drawn.inside.mean((0, 1)))
            rows.append(Covered(*whose, FORECAST, False, *shares, np.nan, drawn.inside.shape[1]))
    return rows


def _pooled(drawn: Drawn) -> Calibration:
    """Of the draws of all seeds together: how many lie below the truth is the sum of how many do of each seed."""
    return Calibration(drawn.count * len(drawn.ranks), drawn.ranks.sum(0), drawn.tarp.sum(0))


def _of_parameters(
    whose: tuple[str, str, str], names: Sequence[str], of_seeds: Sequence[Calibration], pooled: bool = False
) -> list[Covered]:
    """Means over seeds; ``whose``: method, label and set."""
    each = [interval_coverage(c.marginal, c.draws, TABLE_LEVELS).share for c in of_seeds]
    atc = float(np.mean([area_to_curve(c.tarp, c.draws) for c in of_seeds]))
    shares = np.mean(each, axis=0).T.tolist()
    windows = len(of_seeds[0].tarp)
    return [Covered(*whose, name, pooled, *of_name, atc, windows) for name, of_name in zip(names, shares, strict=True)]


def _table(rows: Sequence[Covered], titles: Titles, title: str) -> Table:
    header = ["method", "set", "parameter", *(f"in {100 * x:.0f} % [%]" for x in TABLE_LEVELS), "ATC"]
    printed = []
    for row in rows:
        shares = [f"{100 * share:.1f}" for share in row.shares]
        atc = f"{row.atc:.3f}".replace("-", "−") if np.isfinite(row.atc) else DASH
        name = OWN_TITLE if row.set == OWN else titles.of_set(row.set)
        parameter = f"{row.parameter}, seeds pooled" if row.pooled else row.parameter
        printed.append([row.label, name, parameter, *shares, atc])
    return Table(header, [("", printed)], 3, (), title, CAPTION, "coverage", empty=EMPTY)
