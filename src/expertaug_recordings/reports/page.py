"""One recording's page of the report: what was measured, what was flagged and why, and what is doubtful."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from expertaug import plotting
from expertaug.errors import InputError
from expertaug_recordings.angles.quality import INTERPOLATED, MEASURED, UNUSABLE
from expertaug_recordings.angles.summary import RecordingSummary
from expertaug_recordings.settings import RENDERED
from expertaug_recordings.tables import PLACES, read_table

STATE = ("theta1", "theta2", "omega1", "omega2")
UNCERTAIN = tuple(f"{name}_std" for name in (*STATE, "pivot", "joint", "tip"))
CORRECTED = ("theta1_unsmoothed", "theta2_unsmoothed", "arm1_px", "arm2_px")
COLUMNS = ("t", *STATE, "energy", "quality", "source", *CORRECTED, *UNCERTAIN)
WRONG = "#B00020"
FIRST, SECOND = "#0072B2", "#D55E00"  # of the two arms
STATES = ((MEASURED, "measured", "#009E73"), (INTERPOLATED, "not used", "#E69F00"), (UNUSABLE, "unusable", WRONG))
WIDTH, LINE = 112, 0.165  # of text: characters in a line, and its height in inches


def run_stage(markers: str | Path, angles: str | Path, summary: str | Path, output: str | Path) -> None:
    """Stage: draw a recording's page.

    Arguments:
        markers, angles, summary: what the stage measure-angles read and wrote.
        output: .png or .pdf.

    Raises:
        InputError: a file is missing, lacks a column or a value, or does not fit the others.
    """
    points, table = read_table(markers, PLACES), read_table(angles, COLUMNS)
    recording_summary = RecordingSummary.load(summary)
    source = table["source"].to_numpy(int)
    if len(table) != recording_summary.frames or not ((source >= 0) & (source < len(points))).all():
        raise InputError(markers, f"{len(points)} frames, {angles} has {len(table)}", "run measure_angles again")
    plotting.save_all({Path(output): plot_recording(points, table, recording_summary)})


def plot_recording(points: pd.DataFrame, table: pd.DataFrame, summary: RecordingSummary) -> Figure:
    """A recording's page.

    Panels over time: each arm's corrected length against its median (in grey the distance of its markers) with the
    band that its two markers' standard uncertainties make, both angles, by how much they are smoothed with the band of
    their standard uncertainty, the same band of the speeds, the energy and which frames are used; below, how many
    frames have which reason.  Frames that are not used have lighter dots.

    Arguments:
        points: places of the markers, :data:`~expertaug_recordings.tables.PLACES`, of each analysed frame.
        table: of the angles, :data:`COLUMNS`; ``source`` are rows of ``points``.
    """
    source = table["source"].to_numpy(int)
    heading, reasons = _heading(summary), summary.reasons
    warned = "\n".join(textwrap.fill(f"Warning: {text}.", WIDTH - 14) for text in summary.warnings)
    lines, warned_lines = heading.count("\n") + 1, warned.count("\n") + 1 if warned else 0
    above = 0.35 + LINE * (lines + 1.3 * warned_lines)  # inches
    heights = [0.75, 0.75, 1.5, 0.75, 0.75, 0.75, 1.2, 0.2, 0.1 + 0.2 * max(1, len(reasons))]
    with plotting.use_style():
        height = above + sum(heights) + 1.6
        figure = plotting.new_figure(height)
        figure.get_layout_engine().set(rect=(0, 0, 1, 1 - above / height))
        *over_time, band, bars = figure.subplots(len(heights), 1, gridspec_kw={"height_ratios": heights})

        def write(inches: float, text: str, **look: object) -> None:
            figure.text(0.02, 1 - inches / height, text, ha="left", va="top", linespacing=1.4, **look)

        write(0.08, f"Recording {summary.recording}", fontsize=11, fontweight="bold")
        write(0.35, heading)
        write(0.35 + LINE * (lines + 0.2), warned, color=WRONG, fontweight="bold")
        t, quality = table["t"].to_numpy(float), table["quality"].to_numpy(float)
        _lengths(over_time[:2], t, points.to_numpy(float)[source], table, quality)
        _angles(over_time[2], t, table, quality)
        _draw_smoothed(over_time[3:5], t, table, quality, summary.rotation_error_deg)
        _speeds(over_time[5], t, table)
        _energy(over_time[6], t, table["energy"].to_numpy(float), quality)
        _draw_used(band, t, quality)
        _reasons(bars, reasons, len(t))
        for axis in over_time:
            axis.sharex(band)
            axis.tick_params(labelbottom=False)
        band.set_xlim(t[0], t[-1])
        band.set_xlabel("time [s]")
    return figure


def plot_refused(name: str, reason: str) -> Figure:
    """The page of a recording that was left out: it says why."""
    with plotting.use_style():
        text = textwrap.fill(f"Left out: {reason}", WIDTH - 14)
        figure = plotting.new_figure(0.6 + LINE * (text.count("\n") + 1))
        figure.text(0.02, 0.95, f"Recording {name}", ha="left", va="top", fontsize=11, fontweight="bold")
        figure.text(0.02, 0.05, text, ha="left", va="bottom", color=WRONG, linespacing=1.4)
    return figure


def _heading(summary: RecordingSummary) -> str:
    implied = summary.implied_rate_hz
    rate = "the motion implies none: recordings.arms_m is not known"
    if summary.rate_provenance == RENDERED:
        rate = "the real recordings' constants in their nominal time"
    elif implied is not None:
        rate = f"the motion implies {implied:.1f} Hz ({implied / summary.rate_hz - 1:+.1%})"
    tilt, turned = summary.implied_rotation_deg, f"gravity stated at {summary.rotation_deg:g}°"
    turned += "; the motion implies none" if tilt is None else f", implied at {tilt:.1f}°"
    turned += f"; uncertain by {summary.rotation_error_deg:.2g}°" if summary.rotation_error_deg else ""
    constants = ", ".join(f"{name} {value:.4g}" for name, value in summary.constants.items())
    gaps = f"{summary.gaps} gaps, the longest of {summary.longest_gap_frames} frames" if summary.gaps else "no gaps"
    if summary.pendulum == "single":
        return "\n".join(textwrap.fill(line, WIDTH) for line in _single(summary, gaps, turned))
    off = summary.misfit_deg
    lines = [
        f"{summary.frames} frames, {summary.duration_s:.1f} s; tracked {summary.tracked_share:.2%}, used"
        f" {summary.usable_share:.2%}; {gaps}; {summary.interpolated} frames interpolated",
        f"Frame rate: stated {summary.rate_hz:g} Hz ({summary.rate_provenance}); {rate}; {turned}",
        *_times(summary),
        *_describe_rectified(summary),
        f"Arms {summary.arm1_px:.2f} ± {summary.arm1_std_px:.2f} px and {summary.arm2_px:.2f} ±"
        f" {summary.arm2_std_px:.2f} px; noise of the measured angles {summary.noise1_deg:.3f}° and"
        f" {summary.noise2_deg:.3f}°, of the smoothed ones {summary.uncertainty1_deg:.3f}° and"
        f" {summary.uncertainty2_deg:.3f}°, of the speeds {summary.uncertainty1_rad_s:.2g} and"
        f" {summary.uncertainty2_rad_s:.2g} rad/s",
        _pivot(summary) + _offsets(summary),
        f"Constants {constants} (G in s⁻²); R² {summary.r2_1:.4f} and {summary.r2_2:.4f}"
        + ("" if off is None else f"; angles off its motion by {off[0]:.2g}° and {off[1]:.2g}° rms"),
    ]
    return "\n".join(textwrap.fill(line, WIDTH) for line in lines)


def _pivot(summary: RecordingSummary) -> str:
    seconds = summary.pivot_window_s
    if seconds is None:
        return "The pivot is at rest"
    return "The pivot is followed from frame to frame" if seconds == 0 else f"The pivot is averaged over {seconds:g} s"


def _offsets(summary: RecordingSummary) -> str:
    """Markers that are not on their hinges, by which the angles were corrected."""
    words = {"pivot": "the pivot's marker", "tip": "the second arm's", "joint_arm1": "the joint's on the first arm"}
    words["joint_arm2"] = "the joint's on the second arm"
    named = [f"{words[name]} by {size:.2f} px" for name, size in summary.offsets_px.items()]
    return f"; markers off their hinges, modelled: {', '.join(named)}" if named else "; no marker is off its hinge"


def _single(summary: RecordingSummary, gaps: str, turned: str) -> list[str]:
    """The heading of a single pendulum."""
    omega0, alpha = summary.constants["G1"] ** 0.5, summary.friction[0]
    return [
        f"{summary.frames} frames, {summary.duration_s:.1f} s; tracked {summary.tracked_share:.2%}, used"
        f" {summary.usable_share:.2%}; {gaps}; {summary.interpolated} frames interpolated",
        f"Single pendulum; frame rate stated {summary.rate_hz:g} Hz ({summary.rate_provenance}); {turned}",
        *_times(summary),
        *_describe_rectified(summary),
        f"Arm {summary.arm1_px:.2f} ± {summary.arm1_std_px:.2f} px; noise of the measured angle"
        f" {summary.noise1_deg:.3f}°, of the smoothed one {summary.uncertainty1_deg:.3f}°, of the speed"
        f" {summary.uncertainty1_rad_s:.2g} rad/s",
        f"ω0 {omega0:.4g} rad/s, α {alpha:.3g} s⁻¹; R² {summary.r2_1:.4f}"
        + ("" if summary.misfit_deg is None else f"; angles off its motion by {summary.misfit_deg[0]:.2g}° rms"),
    ]


def _times(summary: RecordingSummary) -> list[str]:
    """What was found of the frames' times, where anything was."""
    timing, said = summary.timing, []
    if summary.span_s is not None:
        first, last = summary.span_s
        said.append(f"from {first:g} s of the video to {'its end' if last is None else f'{last:g} s'}")
    if timing.converted_from_hz is not None:
        said.append(f"put back to those of {timing.converted_from_hz:.5g} frames/s, which the video was converted from")
    if timing.uneven_ms:
        said.append(f"off even ones by up to {timing.uneven_ms:.1f} ms")
    if timing.frames_hz is not None:
        said.append(f"angles resampled from {timing.frames_hz:.4g} frames/s")
    if timing.error_deg is not None:
        said.append("estimated to cost {:.2g}° (median), {:.2g}° (99 %)".format(*timing.error_deg))
    if timing.repeated or timing.dropped:
        said.append(f"{timing.repeated} frames repeated, {timing.dropped} missing")
    if timing.torn:
        said.append(f"{timing.torn} frames torn")
    if timing.blended:
        said.append(f"{timing.blended} frames mixed from two")
    return [f"Times: {'; '.join(said)}"] if said else []


def _describe_rectified(summary: RecordingSummary) -> list[str]:
    """How lens and view were undone, where they were."""
    done = summary.rectified
    if done is None:
        return []
    before = " and ".join(f"{share:.2%}" for share in done.arms_before)
    board = "" if done.board_px is None else f", corners off by {done.board_px:.2f} px"
    return [
        f"View undone by {done.by}{board}: scales differed by {done.stretch - 1:.2%} at the pivot, markers were moved"
        f" by up to {done.moved_px:.1f} px; the arms' lengths varied by {before} before"
    ]


def _dots(axis: Axes, t: np.ndarray, values: np.ndarray, quality: np.ndarray, colour: str, label: str) -> None:
    used = quality == MEASURED
    axis.plot(t[~used], values[~used], ".", color=colour, markersize=1.6, alpha=0.35, rasterized=True)
    axis.plot(t[used], values[used], ".", color=colour, markersize=1.3, label=label, rasterized=True)


def _lengths(axes: Sequence[Axes], t: np.ndarray, points: np.ndarray, table: pd.DataFrame, quality: np.ndarray) -> None:
    """Lengths of the arms from hinge to hinge, off their medians, and how uncertain the markers make them; behind them
    in grey the distances between the markers."""
    seen, length = np.linalg.norm(np.diff(points.reshape(-1, 3, 2), axis=1), axis=2), table[list(CORRECTED[2:])]
    plain, off = _off_median(seen), correct_lengths(length.to_numpy(float), seen)
    reach = 1.3 * float(np.nanquantile(np.abs(off), 0.999)) + 0.05
    each = table[list(UNCERTAIN[len(STATE) :])].to_numpy(float)
    for k, (axis, colour) in enumerate(zip(axes, (FIRST, SECOND), strict=True)):
        band = np.hypot(each[:, k], each[:, k + 1])
        axis.plot(t, plain[:, k], ".", color="0.8", markersize=1.0, rasterized=True)
        _dots(axis, t, off[:, k], quality, colour, "")
        axis.fill_between(t, -band, band, color="0.1", alpha=0.4, linewidth=0, zorder=3, rasterized=True)
        axis.set_ylim(-reach, reach)
        axis.axhline(0, color="0.6", linewidth=0.6)
        axis.set_ylabel(f"arm {k + 1} off\n± std [px]")


def correct_lengths(length: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """By how much corrected lengths (n, 2) in px are off their medians; what a single pendulum lacks is as it was
    ``seen``."""
    return _off_median(np.where(np.isfinite(length).any(0), length, seen))


def _off_median(length: np.ndarray) -> np.ndarray:
    """Lengths (n, 2) less the median of each column; not a number in a column that has none."""
    some = np.isfinite(length).any(0)
    return np.where(some, length - np.nanmedian(np.where(some, length, 0.0), axis=0), np.nan)


def _angles(axis: Axes, t: np.ndarray, table: pd.DataFrame, quality: np.ndarray) -> None:
    for name, colour, label in (("theta1", FIRST, r"$\theta_1$"), ("theta2", SECOND, r"$\theta_2$")):
        turned = np.angle(np.exp(1j * table[name].to_numpy(float)))
        _dots(axis, t, np.rad2deg(turned), quality, colour, label)
    axis.set_ylim(-185, 185)
    axis.set_yticks([-180, -90, 0, 90, 180])
    axis.set_ylabel("angles [°]")
    axis.legend(loc="upper right", ncols=2, markerscale=6)


def _draw_smoothed(
    axes: Sequence[Axes], t: np.ndarray, table: pd.DataFrame, quality: np.ndarray, common_deg: float
) -> None:
    """What smoothing took from each angle, and how uncertain what it left is, without what all angles share."""
    for axis, name, colour, label in zip(axes, STATE, (FIRST, SECOND), (r"$\theta_1$", r"$\theta_2$"), strict=False):
        taken, band = (np.rad2deg(v) for v in (table[f"{name}_unsmoothed"] - table[name], table[f"{name}_std"]))
        band = np.sqrt((band**2 - common_deg**2).clip(lower=0))
        _dots(axis, t, taken.to_numpy(float), quality, "0.7", "")
        axis.fill_between(t, -band, band, color=colour, alpha=0.7, linewidth=0, zorder=3, rasterized=True)
        reach = 4 * float(np.nanquantile(band, 0.9)) if band.notna().any() else 1.0
        axis.set_ylim(-reach, reach)
        axis.set_ylabel(f"{label} ± std,\nmeasured [°]")


def _speeds(axis: Axes, t: np.ndarray, table: pd.DataFrame) -> None:
    """How uncertain the speeds are."""
    largest = 0.0
    for name, colour, label in zip(STATE[2:], (FIRST, SECOND), (r"$\dot\theta_1$", r"$\dot\theta_2$"), strict=True):
        band = table[f"{name}_std"].to_numpy(float)
        axis.fill_between(t, -band, band, color=colour, alpha=0.5, linewidth=0, label=label, rasterized=True)
        largest = max(largest, float(np.nanquantile(band, 0.98)) if np.isfinite(band).any() else 0.0)
    reach = 1.5 * largest + 1e-3
    axis.set_ylim(-reach, reach)
    axis.set_ylabel("speeds ± std\n[rad/s]")
    axis.legend(loc="upper right", ncols=2)


def _energy(axis: Axes, t: np.ndarray, energy: np.ndarray, quality: np.ndarray) -> None:
    _dots(axis, t, energy, quality, "0.25", "energy")
    axis.set_ylim(0, 1.05 * np.nanquantile(energy, 0.999))
    axis.set_ylabel("energy [s⁻²]")


def _draw_used(axis: Axes, t: np.ndarray, quality: np.ndarray) -> None:
    """Which frames are measured, which not: any that is not in a pixel of the band shows there."""
    columns = np.linspace(0, len(t), 1200).astype(int)[:-1]
    worst = np.minimum.reduceat(quality, columns)
    shade = np.select([worst == value for value, *_ in STATES], range(len(STATES)))
    colours = mpl.colors.ListedColormap([colour for *_, colour in STATES])
    axis.imshow(
        shade[None], aspect="auto", cmap=colours, vmin=0, vmax=2, extent=(t[0], t[-1], 0, 1), interpolation="none"
    )
    axis.set_yticks([])
    handles = [mpl.patches.Patch(color=colour, label=label) for _, label, colour in STATES]
    axis.legend(handles=handles, loc="lower right", bbox_to_anchor=(1, 1), ncols=3, borderaxespad=0.1, fontsize=7)
    axis.set_ylabel("frames", rotation=0, ha="right", va="center")


def _reasons(axis: Axes, reasons: Mapping[str, int], total: int) -> None:
    if not reasons:
        axis.axis("off")
        axis.text(0.5, 0.5, "no frame is flagged", transform=axis.transAxes, ha="center", va="center", color="0.3")
        return
    ordered = sorted(reasons.items(), key=lambda item: item[1])
    bars = axis.barh(
        [name.replace("_", " ") for name, _ in ordered], [count for _, count in ordered], color="0.6", height=0.7
    )
    axis.bar_label(bars, [f"{count} ({count / total:.2%})" for _, count in ordered], padding=3, fontsize=7)
    axis.set_xlim(0, 1.2 * ordered[-1][1])
    axis.set_ylim(-0.6, len(ordered) - 0.4)
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.set_xlabel("frames with a reason")
