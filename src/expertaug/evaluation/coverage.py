"""The stage coverage: whether intervals of z_e and bands of forecasts hold, of every version that has any, on the
version's own windows and on every set."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from expertaug import plotting
from expertaug.evaluation.diagnostic_figures import IDEAL, LEVELS
from expertaug.evaluation.forecasts import OWN, Forecasts
from expertaug.evaluation.settings import Titles, WindowStudyJob
from expertaug.evaluation.table import DASH, Study, Table
from expertaug.evaluation.windows import Drawn, VersionWindows, windows_of
from expertaug.inference.diagnostics.calibration import TABLE_LEVELS, Calibration, area_to_curve, interval_coverage
from expertaug.rows import frame
from expertaug.versions import LINES, Version

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


def run_stage(forecasts: Sequence[Path], outputs: Sequence[Path], job: WindowStudyJob) -> None:
    """Stage: write the table of an experiment's coverage and draw it.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds.
        outputs: any of .csv, .md, .tex, .png and .pdf.

    Raises:
        InputError: a file is broken, or an output's suffix is unknown.
    """
    coverage(map(Forecasts.load, forecasts), job).save(outputs)


def coverage(forecasts: Iterable[Forecasts], job: WindowStudyJob) -> Study:
    """The table and the figure of an experiment's coverage; where no version has intervals they say so.

    Arguments:
        forecasts: of all versions and groups of seeds.

    Raises:
        InputError: as of :func:`windows_of`.
    """
    versions, labels = windows_of(forecasts), job.label_of
    drawn = {v: versions[v] for v in labels if v in versions and any(s.drawn for s in versions[v].sets.values())}
    rows = [row for v, version in drawn.items() for row in _rows(v, labels[v], version)]
    title = f"{job.of_experiment(next(iter(versions.values())).experiment)}: coverage of intervals"
    return Study(frame(Covered, rows), [_table(rows, job, title)], lambda: _draw(drawn, job, title))


def _draw(versions: Mapping[str, VersionWindows], job: WindowStudyJob, title: str) -> Figure:
    """Share of the true parameters within central intervals against what these claim: a panel for each kind of
    windows, a line for each version, the mean over parameters and seeds."""
    able = [v for v in versions if v != job.floor]
    first = sorted(able, key=lambda v: (not Version.parse(v).is_flow, v not in job.traced))[:LINES]
    shown = [v for v in able if v in first]
    if not shown:
        return plotting.note(EMPTY)
    colours = plotting.colours(shown, dict(job.hues))
    judged = list(dict.fromkeys(name for v in shown for name in versions[v].judged))
    kinds = {OWN_TITLE: [versions[v].own for v in shown]}
    kinds |= {job.of_set(name): [_draws_of(versions[v], name) for v in shown] for name in judged}
    kinds = {name: each for name, each in kinds.items() if any(draws is not None for draws in each)}
    with plotting.use_style():
        figure = plotting.new_figure(3.2, min(plotting.WIDTH, 1.2 + 2.2 * len(kinds)))
        for axis, (name, each) in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds.items(), strict=True):
            level = np.array([0.0, *LEVELS, 1.0])
            windows = min(draws.tarp.shape[1] for draws in each if draws is not None)
            spread = 1.96 * np.sqrt(level * (1 - level) / windows)
            axis.fill_between(100 * level, 100 * (level - spread), 100 * (level + spread), color="0.88", linewidth=0)
            axis.plot([0, 100], [0, 100], **IDEAL)
            for v, drawn in zip(shown, each, strict=True):
                if drawn is not None:
                    axis.plot(
                        100 * level,
                        100 * _count_covered(drawn),
                        linewidth=1.3,
                        **plotting.look(v, colours) | {"marker": ""},
                    )
            axis.set(title=name, xlabel="level of the intervals [%]", xlim=(0, 100), ylim=(0, 100))
        figure.axes[0].set_ylabel("windows within [%]")
        looks = {v: plotting.look(v, colours) | {"marker": ""} for v in shown}
        handles: list[Artist] = [Line2D([], [], label=job.label_of[v], **look) for v, look in looks.items()]
        handles += [
            Line2D([], [], label="as claimed", **IDEAL),
            Patch(color="0.88", label="95 % band of intervals that hold"),
        ]
        plotting.legend(figure, handles)
        plotting.heading(figure, plotting.text(title))
    return figure


def _draws_of(version: VersionWindows, name: str) -> Drawn | None:
    return version.sets[name].drawn if name in version.sets else None


def _count_covered(drawn: Drawn) -> np.ndarray:
    """Share within the central interval of each of the levels, with 0 and 1 at the ends."""
    each = [_calibration(drawn, k) for k in range(len(drawn.ranks))]
    shares = np.mean([interval_coverage(c.marginal, c.draws, LEVELS).share.mean(1) for c in each], axis=0)
    return np.concatenate([[0.0], shares, [1.0]])


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
            rows += _of_parameters(whose, of.parameters, [_pool(drawn)], pooled=True)
        if drawn.inside is not None:
            shares = map(float, drawn.inside.mean((0, 1)))
            rows.append(Covered(*whose, FORECAST, False, *shares, np.nan, drawn.inside.shape[1]))
    return rows


def _pool(drawn: Drawn) -> Calibration:
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
