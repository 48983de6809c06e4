"""Figures of diagnostics: is a posterior calibrated, and does an alarm know which forecasts fail?"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.typing import LineStyleType

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.inference.diagnostics.alarm import Assessment, roc
from expertaug.inference.diagnostics.calibration import Calibration, area_to_curve, interval_coverage
from expertaug.inference.diagnostics.uniformity import Uniformity, uniformity

# Told apart by hue and by dash: lines of calibrated posteriors lie on one another.
_DASHES: tuple[LineStyleType, ...] = ("-", (0, (4, 1.4)), (0, (1.2, 1.2)), "-.", "-", (0, (4, 1.4)))
LOOKS: tuple[plotting.Look, ...] = tuple(
    {"color": plotting.HUES[hue], "linestyle": dash} for hue, dash in zip((5, 6, 4, 3, 1, 2), _DASHES, strict=True)
)
WHOLE = {"color": "0.1", "linestyle": "-", "linewidth": 1.0}  # all parameters at once
IDEAL = {"color": "0.55", "linewidth": 0.7, "zorder": 1}
BAND = {"color": "0.88", "linewidth": 0, "zorder": 0}
LEVELS = tuple(np.arange(1, 100) / 100)
SMALL = 6.5  # font size inside panels
LINE = 0.09  # height of a line of text, as a share of a panel's


def draw_calibration(kinds: Mapping[str, Calibration], parameters: Sequence[str], title: str = "") -> Figure:
    """Ranks, coverage of intervals and TARP: a row each, a column for each kind of windows, all with their 95 % band.

    Arguments:
        kinds: what is printed for a kind of windows → ranks on it, as of draws of the model itself, of the validation
            and of the test set.
        parameters: their names, P of them.
        title: what the figure is of.

    Raises:
        InputError: nothing to draw, or other numbers of parameters.
    """
    if not kinds:
        raise InputError("kinds", "none", "give ranks of at least one kind of windows")
    for name, calibration in kinds.items():
        if calibration.marginal.shape[1] != len(parameters):
            where = f"of {calibration.marginal.shape[1]} parameters"
            raise InputError(f"kinds[{name!r}]", where, f"there are {len(parameters)} names")
    with plotting.use_style():
        figure = plotting.new_figure(6.2, min(plotting.WIDTH, 1.2 + 2.0 * len(kinds)))
        grid = figure.subplots(3, len(kinds), squeeze=False, sharex=True, sharey="row")
        between = ", " if len(kinds) < 4 else ",\n"
        for column, (name, calibration) in zip(grid.T, kinds.items(), strict=True):
            _ranks(column[0], calibration, parameters)
            _intervals(column[1], calibration, parameters)
            _tarp(column[2], calibration)
            size = f"({len(calibration.marginal)} windows{between}{calibration.draws} draws each)"
            column[0].set_title(f"{plotting.text(name)}\n{size}")
            column[2].set_xlabel("credibility level")
        low, high = grid[0, 0].get_ylim()
        lines = len(parameters) * LINE + 0.02
        grid[0, 0].set_ylim(low, high + (high - low) * lines / (1 - lines))  # the p-values above all curves
        labels = ("ranks: share below − level", "windows within the interval", "TARP: expected coverage")
        for axis, label in zip(grid[:, 0], labels, strict=True):
            axis.set_ylabel(label)
        handles: list[Artist] = []
        handles += [Line2D([], [], label=plotting.symbol(p), **look) for p, look in _looks(parameters)]
        handles.append(Line2D([], [], label="all parameters at once", **WHOLE))
        handles.append(Patch(facecolor=BAND["color"], label="95 % band of a calibrated posterior"))
        plotting.legend(figure, handles)
        if title:
            plotting.heading(figure, plotting.text(title))
    return figure


def draw_alarm(scores: Mapping[str, Assessment], title: str = "") -> Figure:
    """ROC curves, a dot where the threshold is, and the error of the windows kept: a line for each score.

    Arguments:
        scores: what is printed for a score → what it is worth, all on the same windows.
        title: what the figure is of.

    Raises:
        InputError: nothing to draw, or scores of different windows.
    """
    if not scores:
        raise InputError("scores", "none", "give at least one")
    first = next(iter(scores.values()))
    if any(not np.array_equal(each.risk.best, first.risk.best) for each in scores.values()):
        raise InputError("scores", "of windows with different errors", "assess all on the same windows")
    with plotting.use_style():
        figure = plotting.new_figure(3.6)
        left, right = figure.subplots(1, 2)
        handles = []
        for (name, assessment), (_, look) in zip(scores.items(), _looks(scores), strict=True):
            if first.failing.any() and not first.failing.all():
                left.step(*roc(assessment.scores, assessment.failing), where="post", **look)
                left.plot(
                    assessment.false_alarms,
                    assessment.caught,
                    marker="o",
                    markersize=4,
                    color=look["color"],
                    clip_on=False,
                )
            right.plot(assessment.risk.kept, assessment.risk.risk, **look)
            handles.append(Line2D([], [], label=f"{name}: {_area_text(assessment)}", **look))
        left.plot([0, 1], [0, 1], **IDEAL)
        right.plot(first.risk.kept, first.risk.best, color="0.45", linewidth=0.9, linestyle=(0, (4, 2)))
        right.axhline(first.risk.risk[-1], **IDEAL)
        bad = f"{first.failing.sum()} of {len(first.failing)} forecasts fail"
        left.set(xlabel="false alarms (share of good forecasts)", ylabel="failing forecasts caught (share)", title=bad)
        left.set(xlim=(-0.02, 1), ylim=(0, 1.02))
        right.set(xlabel="share of the windows kept", ylabel="mean squared error of the windows kept", xlim=(0, 1.01))
        right.set(title="most suspicious windows refused first")
        plotting.plain_log(right)
        for axis in (left, right):
            axis.grid()
        dot = {"linestyle": "", "marker": "o", "markersize": 4, "color": "0.3"}
        handles.append(Line2D([], [], label="threshold from validation", **dot))
        best = {"color": "0.45", "linestyle": (0, (4, 2)), "linewidth": 0.9}
        handles.append(Line2D([], [], label="refused by the true error", **best))
        handles.append(Line2D([], [], label="refused at random", **IDEAL))
        plotting.legend(figure, handles)
        if title:
            plotting.heading(figure, plotting.text(title))
    return figure


def _looks(names: Iterable[str]) -> list[tuple[str, plotting.Look]]:
    return [(name, LOOKS[k % len(LOOKS)]) for k, name in enumerate(names)]


def _ranks(axis: Axes, calibration: Calibration, parameters: Sequence[str]) -> None:
    """The distribution of ranks less the uniform one."""
    test = uniformity(calibration.marginal, calibration.draws)
    x = _close(test.level)
    axis.fill_between(x, _close(test.lower) - x, _close(test.upper) - x, **BAND)
    axis.axhline(0, **IDEAL)
    for k, (name, look) in enumerate(_looks(parameters)):
        axis.plot(x, _close(test.share[:, k]) - x, **look)
        words, place = f"{plotting.symbol(name)}: {_p_text(float(test.p_value[k]))}", (0.97, 1 - LINE * k)
        inside = {"xycoords": "axes fraction", "ha": "right", "va": "top", "fontsize": SMALL}
        axis.annotate(words, place, color=look["color"], **inside)
    axis.margins(x=0)


def _intervals(axis: Axes, calibration: Calibration, parameters: Sequence[str]) -> None:
    """Central intervals of each parameter, and regions of highest density of all."""
    covered = interval_coverage(calibration.marginal, calibration.draws, LEVELS)
    test = uniformity(calibration.tarp if calibration.density is None else calibration.density, calibration.draws)
    _diagonal(axis, test)
    for k, (_, look) in enumerate(_looks(parameters)):
        axis.plot(_close(covered.level), _close(covered.share[:, k]), **look)
    if calibration.density is not None:
        axis.plot(_close(test.level), _close(test.share), **WHOLE)
        _note(axis, f"highest density\n{_p_text(float(test.p_value))}")


def _tarp(axis: Axes, calibration: Calibration) -> None:
    test = uniformity(calibration.tarp, calibration.draws)
    _diagonal(axis, test)
    axis.plot(_close(test.level), _close(test.share), **WHOLE)
    area = f"{float(area_to_curve(calibration.tarp, calibration.draws)):+.3f}".replace("-", "−")
    _note(axis, f"area {area}\n{_p_text(float(test.p_value))}")


def _diagonal(axis: Axes, test: Uniformity) -> None:
    x = _close(test.level)
    axis.fill_between(x, _close(test.lower), _close(test.upper), **BAND)
    axis.plot([0, 1], [0, 1], **IDEAL)
    axis.set(xlim=(0, 1), ylim=(0, 1))


def _close(inner: np.ndarray) -> np.ndarray:
    """Values with the 0 before and the 1 after them, where every distribution begins and ends."""
    return np.concatenate([[0.0], inner, [1.0]])


def _note(axis: Axes, words: str) -> None:
    axis.annotate(words, (0.97, 0.04), xycoords="axes fraction", ha="right", va="bottom", fontsize=SMALL, color="0.25")


def _p_text(p: float) -> str:
    return "p < 0.001" if p < 0.001 else f"p = {p:.3f}" if p < 0.1 else f"p = {p:.2f}"


def _area_text(assessment: Assessment) -> str:
    """AUROC with its interval and the share caught, as far as there are windows to tell."""
    area = assessment.area
    if not area.failing:
        return f"{100 * assessment.false_alarms:.0f} % false alarms"
    caught = f"{100 * assessment.caught:.0f} % caught"
    if not area.others:
        return caught
    interval = "" if np.isnan(area.lower) else f" ({area.lower:.3f} to {area.upper:.3f})"
    return f"AUROC {area.value:.3f}{interval}, {caught}"
