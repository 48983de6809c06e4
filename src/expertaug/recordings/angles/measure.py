"""Arm angles, speeds and energy from marker positions, calibrated per recording."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter1d

from expertaug.errors import InputError
from expertaug.files import atomic, write_json
from expertaug.recordings.angles.pendulum_fit import fit_constants, implied_rate
from expertaug.recordings.angles.settings import AngleSettings
from expertaug.recordings.angles.smoothing import Motion, smooth_motion, window_frames
from expertaug.recordings.angles.tilt import implied_tilt
from expertaug.recordings.columns import MARKERS, PLACES
from expertaug.recordings.options import read_settings
from expertaug.systems.double_pendulum import energy

NO_PIVOT = "pivot_interpolated"  # reason of a measured frame whose pivot comes from its neighbours
MAX_RATE_ERROR = 0.05  # of the stated frame rate, beyond which the motion contradicts it
MAX_TILT_DEG = 1.5  # off the stated direction of gravity, beyond which the motion contradicts it
SPAN_S = 0.01  # between the points by which the constants are fitted
MEASURED, INTERPOLATED, UNUSABLE = 1.0, 0.5, 0.0
logger = logging.getLogger(__name__)


def measure_angles(
    markers: str | Path, output: str | Path, summary: str | Path, settings: Mapping[str, object] | None = None
) -> None:
    """Measure a recording's angles.

    The pivot and the arm lengths are calibrated on the recording itself.  Angles and speeds come from one local
    polynomial (Savitzky-Golay) over each gap-free stretch, whose window was chosen on simulated motion with the noise
    of the real labels (tests/recordings/test_angles.py).

    Arguments:
        markers: CSV of frame, t (s), pivot_x ... tip_y (px), quality, reason; every analysed frame, evenly timed.
        output: CSV of frame, t, theta1, theta2 (rad, unwrapped within a stretch, 0 at rest), omega1, omega2 (rad/s),
            energy (s⁻²), quality (1 measured, .5 interpolated or at a stretch's end, 0 unusable), reason.
        summary: JSON of the recording's calibration, its gaps, how many frames have which reason, what its motion
            implies, and in plain words what is doubtful (``warnings``).
        settings: see :class:`AngleSettings`.

    Raises:
        InputError: a missing column, uneven times, too few usable frames, or motion that is no pendulum's.
    """
    markers = Path(markers)
    options = read_settings(AngleSettings, settings, "angles")
    table = _read_markers(markers)
    t, rate = table["t"].to_numpy(float), _frame_rate(markers, table["t"].to_numpy(float))
    red, green, blue = table[list(PLACES)].to_numpy(float).reshape(-1, 3, 2).swapaxes(0, 1)
    reason = table["reason"].fillna("").astype(str).to_numpy(object)
    # A frame whose red marker alone is lost keeps its arms: the pivot hardly moves, its neighbours tell where it is.
    # Any other flag of the tracker, also a doubt, costs the frame.
    lost = pd.Series(reason).str.startswith("lost").to_numpy()
    rejected = (~(table["quality"].to_numpy(float) > 0) | (reason != "")) & ~lost
    usable = np.isfinite(green).all(1) & np.isfinite(blue).all(1) & ~rejected
    reason[~usable & (reason == "")] = "lost"
    if usable.sum() < max(10, options.min_usable_s * rate) or not np.isfinite(red).any():
        raise _too_few(markers, int(usable.sum()), len(t), rate, options)
    tracked = usable.copy()

    pivot, no_pivot = _pivot(red, green, usable, rate, options)
    vectors = np.stack((green - pivot, blue - green), axis=1)
    lengths = np.linalg.norm(vectors, axis=-1)
    arms = np.median(lengths[usable], axis=0)
    with np.errstate(invalid="ignore"):
        off = usable & (np.abs(lengths - arms) > options.arm_tolerance * arms).any(1)
    usable &= ~off
    reason[off] = "arm_length"
    if usable.sum() < max(10, options.min_usable_s * rate):
        raise _too_few(markers, int(usable.sum()), len(t), rate, options)

    theta = np.arctan2(vectors[..., 0], vectors[..., 1]) - np.deg2rad(options.rotation_deg)
    motion = smooth_motion(
        np.where(usable[:, None], theta, np.nan),
        rate,
        window=window_frames(options.smoothing_window_s, options.smoothing_order, rate),
        order=options.smoothing_order,
        longest_gap=max(0, min(options.max_gap_frames, int(np.ceil(np.pi * rate / options.max_speed)) - 2)),
        sigmas=options.outlier_sigmas,
        floor=np.deg2rad(options.outlier_floor_deg),
    )
    quality = _judge(motion, usable, reason)
    reason[(quality == MEASURED) & no_pivot] = NO_PIVOT
    good = quality == MEASURED
    if good.sum() < max(10, options.min_usable_s * rate):
        raise _too_few(markers, int(good.sum()), len(t), rate, options)
    try:
        every = max(1, round(rate * SPAN_S))
        fit = fit_constants(np.where(good[:, None], motion.y, np.nan), every / rate, friction=True, every=every)
    except InputError as error:
        raise InputError(markers, str(error)) from error
    level = energy(motion.y, fit.constants)

    columns = {"frame": table["frame"], "t": t}
    columns |= {name: motion.y[:, k] for k, name in enumerate(("theta1", "theta2", "omega1", "omega2"))}
    angles = pd.DataFrame({**columns, "energy": level, "quality": quality, "reason": reason})
    with atomic(output) as temporary:
        angles.to_csv(temporary, index=False, float_format="%.9g")
    gaps = _gap_lengths(quality != UNUSABLE)
    spread = np.std(lengths[usable], axis=0)
    second = max(1, round(rate))
    implied = None if options.arm1_m is None else implied_rate(fit.constants, rate, options.arm1_m)
    tilt = implied_tilt(np.where(good[:, None], motion.y, np.nan), every / rate, every)
    warnings = _warnings(rate, implied, tilt, options)
    for text in warnings:
        logger.warning("%s: %s", Path(output).parent.name, text)
    write_json(
        summary,
        {
            "recording": Path(output).parent.name,
            "frames": len(t),
            "duration_s": len(t) / rate,
            "tracked_share": float(tracked.mean()),
            "usable_share": float(good.mean()),
            "arm1_px": float(arms[0]),
            "arm1_std_px": float(spread[0]),
            "arm2_px": float(arms[1]),
            "arm2_std_px": float(spread[1]),
            "pivot_x_px": float(np.median(pivot[:, 0])),
            "pivot_y_px": float(np.median(pivot[:, 1])),
            "noise1_deg": float(np.rad2deg(motion.noise[0])),
            "noise2_deg": float(np.rad2deg(motion.noise[1])),
            "gaps": len(gaps),
            "longest_gap_frames": max(gaps, default=0),
            "interpolated": int((reason == "interpolated").sum()),
            "rejected_arm_length": int(off.sum()),
            "rejected_outlier": int((reason == "outlier").sum()),
            "reasons": dict(sorted(Counter(text for text in reason if text).items())),
            "rate_hz": rate,
            "rate_provenance": options.rate_provenance,
            "implied_rate_hz": implied,
            "rotation_deg": options.rotation_deg,
            "implied_rotation_deg": None if tilt is None else options.rotation_deg + tilt,
            "warnings": warnings,
            "constants": fit.constants.to_dict(),
            "friction": list(fit.friction),
            "r2_1": fit.r2[0],
            "r2_2": fit.r2[1],
            "energy_start": float(np.median(level[good][:second])),
            "energy_end": float(np.median(level[good][-second:])),
        },
    )


def _read_markers(path: Path) -> pd.DataFrame:
    try:
        table = pd.read_csv(path, dtype={"reason": str}, keep_default_na=True)
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "run track_markers") from error
    except (ValueError, OSError) as error:
        raise InputError(path, f"not a marker table ({error})", "run track_markers again") from error
    missing = [c for c in MARKERS if c not in table]
    if missing:
        raise InputError(path, f"column {missing[0]} is missing", f"expected {','.join(MARKERS)}")
    for name in MARKERS[:-1]:
        if not pd.api.types.is_numeric_dtype(table[name]):
            bad = pd.to_numeric(table[name], errors="coerce").isna() & table[name].notna()
            row = int(np.argmax(bad.to_numpy()))
            cell = table[name].iloc[row]
            raise InputError(path, f"row {row + 2}, column {name}: '{cell}' is no number", "expected numbers")
    return table


def _frame_rate(path: Path, t: np.ndarray) -> float:
    if len(t) < 10:
        raise InputError(path, f"{len(t)} frames", "a recording needs at least 10")
    rate = (len(t) - 1) / (t[-1] - t[0]) if t[-1] > t[0] else np.nan
    uneven = ~(np.abs(np.diff(t) * rate - 1) < 0.01)
    if uneven.any():
        row = int(np.argmax(uneven))
        found = f"times are uneven: {t[row]} s, then {t[row + 1]} s"
        raise InputError(path, found, "expected every analysed frame, evenly timed")
    return float(round(rate, 6))


def _too_few(path: Path, found: int, total: int, rate: float, options: AngleSettings) -> InputError:
    wanted = max(10, int(np.ceil(options.min_usable_s * rate)))
    remedy = f"at least {wanted} are needed: check the tracking"
    return InputError(path, f"{found} of {total} frames are usable", remedy)


def _warnings(rate: float, implied: float | None, tilt: float | None, options: AngleSettings) -> list[str]:
    """What the motion contradicts, in plain words."""
    found = []
    if implied is not None and abs(implied / rate - 1) > MAX_RATE_ERROR:
        side = "above" if implied > rate else "below"
        found.append(
            f"the motion implies {implied:.1f} Hz, {abs(implied / rate - 1):.0%} {side} the stated {rate:g} Hz"
            f" ({options.rate_provenance}): that rate or the first arm's length of {options.arm1_m:g} m is wrong"
        )
    if tilt is not None and abs(tilt) > MAX_TILT_DEG:
        found.append(
            f"by the motion gravity points {tilt:+.1f}° off the stated direction: set recordings.angles.rotation_deg to"
            f" {options.rotation_deg + tilt:.1f}"
        )
    return found


def _pivot(
    red: np.ndarray, green: np.ndarray, usable: np.ndarray, rate: float, options: AngleSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Pivot of each frame, (n, 2): red where it is near its median, neighbours elsewhere, averaged over a window; and
    the frames (n,) in which it was taken from neighbours.

    On the real recordings the arm's length follows the red marker's displacement: the stand sways, so a constant pivot
    is wrong; but the labels' own noise (.1 px) need not enter the angle.  Of 200 ms forecasts on the fastest parts the
    log-MSE is -7.99 with a constant pivot, -8.42 with each frame's own and -8.49 averaged over .04 s.
    """
    seen = np.isfinite(red).all(1)
    middle = np.median(red[seen], axis=0)
    arm = float(np.nanmedian(np.linalg.norm(green[usable] - middle, axis=1)))
    with np.errstate(invalid="ignore"):
        seen &= np.linalg.norm(red - middle, axis=1) <= options.pivot_tolerance * arm
    frames = np.arange(len(red))
    filled = np.stack([np.interp(frames, frames[seen], red[seen, k]) for k in range(2)], axis=1)
    size = 2 * round(options.pivot_window_s * rate / 2) + 1
    return uniform_filter1d(filled, size, axis=0, mode="nearest"), ~seen


def _judge(motion: Motion, usable: np.ndarray, reason: np.ndarray) -> np.ndarray:
    """Quality per frame; writes the reasons of what was interpolated, rejected or cut short into ``reason``."""
    reason[usable] = ""
    reason[motion.outlier] = "outlier"
    inside = np.isfinite(motion.y[:, 0])
    filled = inside & (~usable | motion.outlier)
    reason[filled] = "interpolated"
    reason[motion.margin & ~filled] = "margin"
    reason[~inside & usable & ~motion.outlier] = "short_stretch"
    quality = np.where(inside, MEASURED, UNUSABLE)
    quality[filled | motion.margin] = INTERPOLATED
    return quality


def _gap_lengths(present: np.ndarray) -> list[int]:
    """Lengths of the runs of frames that are not present."""
    edges = np.diff(np.concatenate(([0], (~present).astype(np.int8), [0])))
    return (np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)).tolist()
