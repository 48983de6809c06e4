"""Arm angles, speeds and energy from marker positions, calibrated per recording.

A speed from finite differences errs by what the angle does between its frames, which the frames themselves hardly
tell.  The equation of motion does: started from a frame's state, forwards and backwards, it gives the angles at the
neighbouring frames, whose differences are off that state's speed by as much as the measured ones are off the truth.
The speeds stay as they were measured; only their stated uncertainty is by the equation.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug.systems.double_pendulum import energy
from expertaug_recordings.angles.arms import STILL_S, Arms, find_arms
from expertaug_recordings.angles.forecast import forecast
from expertaug_recordings.angles.marker_table import FEWEST, MarkerTable, read_markers
from expertaug_recordings.angles.noise import Noise, marker_noise, measure_noise
from expertaug_recordings.angles.pendulum_fit import (
    Fit,
    Implied,
    contradictions,
    direction_error,
    explain,
    explain_single,
    single_energy,
)
from expertaug_recordings.angles.quality import (
    CORRECTED,
    MEASURED,
    UNUSABLE,
    gap_lengths,
    is_crowded,
    judge,
    too_few,
    trust_tracker,
)
from expertaug_recordings.angles.rectify import Rectified, rectify
from expertaug_recordings.angles.rolling import Rolling, undo_rolling
from expertaug_recordings.angles.shooting import Misfit, misfit
from expertaug_recordings.angles.smoothing import (
    Motion,
    Smoothing,
    Window,
    fill_errors,
    longest_window,
    smooth_motion,
    window_frames,
)
from expertaug_recordings.angles.summary import RecordingSummary, RectifiedSummary, TimingSummary
from expertaug_recordings.settings import MeasureAnglesJob

LEAST_R2 = 0.75  # of the fit to the changes of speed; below, the pendulum is no guide to the motion
STATE = ("theta1", "theta2", "omega1", "omega2")
SECOND = ("theta2", "omega2", "tip", "arm2")  # columns that a single pendulum has nothing for begin so
MOST_UNSMOOTHED = 0.5  # share of angles without smoothing that needs no word
FEW = 0.5  # share of usable frames, below which they are why a fit fails
MOST_WORSE = 1.5  # times the markers' noise, of smoothed angles
LATE_MS = 0.05  # by which frames are off their times where it is said


def with_motion_between(motion: Motion, fit: Fit, noise: Noise, rate: float) -> Motion:
    """The motion with uncertainties of finite differences by the fitted pendulum's own motion.

    Arguments:
        motion: as it was measured.
        fit: of the pendulum to it.
        noise: of the angles.
        rate: frames per second.
    """
    if min(fit.r2) < LEAST_R2:
        return motion
    std = motion.std.copy()
    for reach in np.unique(motion.reach[motion.reach > 0]):
        weights = Window(reach, 2 * reach, -1).weights(1, rate)
        frames = np.flatnonzero((motion.reach == reach).any(1))
        states = np.nan_to_num(motion.y[frames])
        bias = np.einsum("nfk,f->nk", _neighbours(states, fit, reach, 1 / rate), weights) - states[:, 2:]
        modelled = np.sqrt([noise.variance(weights, k) for k in (0, 1)] + bias**2)
        stated = std[frames, 2:]
        better = (motion.reach[frames] == reach) & np.isfinite(stated) & np.isfinite(modelled)
        std[frames, 2:] = np.where(better, modelled, stated)
    return replace(motion, std=std)


def _neighbours(states: np.ndarray, fit: Fit, reach: int, interval: float) -> np.ndarray:
    """Angles (n, 2 reach + 1, 2) before, at and after each of the states (n, 4)."""
    constants, sides = fit.constants, []
    if constants.B2 == 0:  # a single pendulum: what hangs on it does nothing (B1 = 0), and may be anything
        constants = replace(constants, B2=1.0)
    for sign in (-1, 1):  # backwards in time, speeds and friction change their sign
        start = torch.as_tensor(states * [1, 1, sign, sign])
        friction = (sign * fit.friction[0], sign * fit.friction[1])
        sides.append(forecast(start, reach + 1, interval, constants, friction)[..., :2].numpy())
    return np.concatenate((sides[0][:, :0:-1], sides[1]), axis=1)


def with_errors(motion: Motion, error: np.ndarray, order: int, rate: float) -> Motion:
    """The motion with uncertainties that hold further errors of the angles; a speed's come from its frames' angles.

    Arguments:
        motion: with the uncertainties that the markers' noise makes.
        error: standard deviations in rad, (n, 2); NaN where nothing is known: there the largest that is.
        order: of the smoothing polynomials.
        rate: frames per second.
    """
    std, error = motion.std.copy(), fill_errors(error)
    std[:, :2] = np.hypot(std[:, :2], error)
    for reach in np.unique(motion.reach):
        window = Window(reach, 2 * reach, -1) if reach else Window(order // 2 + 1, order, -1)
        gain = float(np.linalg.norm(window.weights(1, rate)))
        std[:, 2:] = np.where(motion.reach == reach, np.hypot(std[:, 2:], gain * error), std[:, 2:])
    return replace(motion, std=std)


logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Angles:
    """Angles of n frames, and what they were made from.

    Attributes:
        markers, arms: the recording's.
        tracked, fitting: (n,), frames that the tracker found and whose arms have their lengths.
        noise: of the measured angles.
        length_std, marker_std: standard deviations of the arms' lengths, (2,), and of the coordinates of pivot, joint
            and tip, (3,), in px.
        motion: the smoothed angles and speeds.
        quality, reason: (n,), of each frame.
        implied: by the motion.
        energy: (n,) in s⁻².
        off: how far the angles are off any pendulum's motion; None where that cannot be told.
    """

    markers: MarkerTable
    arms: Arms
    tracked: np.ndarray
    fitting: np.ndarray
    noise: Noise
    length_std: np.ndarray
    marker_std: np.ndarray
    motion: Motion
    quality: np.ndarray
    reason: np.ndarray
    implied: Implied
    energy: np.ndarray
    off: Misfit | None

    def direction_error(self, job: MeasureAnglesJob) -> float:
        """Standard uncertainty in rad of the stated direction of gravity, which both angles of all frames share."""
        return float(np.deg2rad(direction_error(self.implied.gravity, job.rotation_error_deg, job.rotation_deg != 0)))

    def std(self, job: MeasureAnglesJob) -> np.ndarray:
        """Standard uncertainties (n, 4) of angles and speeds, with that of the direction of gravity."""
        both = np.array([1.0, 1.0, 0.0, 0.0]) * self.direction_error(job)
        return np.hypot(self.motion.std, both)

    def raw(self, rotation_deg: float) -> np.ndarray:
        """Angles (n, 2) in rad as each frame's markers alone have them, where they are used; unwrapped likewise."""
        seen = np.isfinite(self.markers.pivot)
        pivot = np.where(seen, self.markers.pivot, self.arms.pivot)
        places = np.stack((pivot, self.markers.joint, self.markers.tip), axis=1)
        off = angles_of(places) - np.deg2rad(rotation_deg) - self.motion.raw
        return self.motion.raw + np.angle(np.exp(1j * off))

    @property
    def unexplained(self) -> Misfit | None:
        """The same where it is more than the markers' noise."""
        return self.off if self.off is not None and self.off.beyond else None


@dataclass(frozen=True)
class Measurement:
    """What was measured of a recording.

    Attributes:
        angles: a row a frame: frame, t, theta1, theta2 (rad, unwrapped within a stretch, 0 at rest), omega1, omega2
            (rad/s), energy (s⁻²), quality (1 measured, .5 interpolated or at a stretch's end, 0 unusable), reason;
            theta1_raw, theta2_raw (rad) as the markers alone have them; theta1_unsmoothed, theta2_unsmoothed (rad)
            corrected for markers off their hinges; theta1_std ... omega2_std, the standard uncertainties, the angles'
            with that of the direction of gravity; arm1_px, arm2_px, the corrected lengths; pivot_std, joint_std,
            tip_std (px), the uncertainties of the markers' coordinates; source, the row of the markers' table that is
            nearest in time.
        summary: of all frames.
    """

    angles: pd.DataFrame
    summary: RecordingSummary


def run_stage(markers: str | Path, output: str | Path, summary: str | Path, job: MeasureAnglesJob) -> None:
    """Stage: measure a recording's angles.

    Arguments:
        markers: CSV of frame, t (s), pivot_x ... tip_y (px), quality, reason; every analysed frame in order of time.
        output: CSV of :attr:`Measurement.angles`, in the folder that the recording is called by.
        summary: JSON of :class:`expertaug_recordings.angles.summary.RecordingSummary`.
        job: its settings.

    Raises:
        InputError: a missing column, times that do not grow, or as of :func:`measure_angles`.
    """
    seen = read_markers(Path(markers), job.rate_hz, job.corrections, job.single)
    measurement = measure_angles(seen, job, Path(output).parent.name, Path(markers))
    with atomic(output) as temporary:
        measurement.angles.to_csv(temporary, index=False, float_format="%.9g")
    for text in measurement.summary.warnings:
        logger.warning("%s: %s", measurement.summary.recording, text)
    measurement.summary.save(summary)


def measure_angles(
    markers: MarkerTable, job: MeasureAnglesJob, recording: str = "recording", path: Path = Path("markers")
) -> Measurement:
    """Measure a recording's angles.

    The pivot, the arm lengths and the offsets of markers from their hinges are calibrated on the recording itself, and
    so is the markers' noise.  Angles and speeds come from local polynomials (Savitzky-Golay) over each gap-free
    stretch, of so many frames as help (:mod:`.smoothing`).

    Arguments:
        markers: of every analysed frame.
        job: its settings; the pictures of a checkerboard that it names are read.
        recording: its name.
        path: what messages call the markers.

    Raises:
        InputError: too few usable frames, or motion that is no pendulum's.
    """
    if job.single:
        job = job.model_copy(update={"model_offsets": False})
    at_once, rolling = (markers, None) if job.single else undo_rolling(markers, trust_tracker(markers)[0])
    markers_in_plane, rectified = rectify(path, at_once, job)
    angles = _measure(path, markers_in_plane, job)
    return Measurement(_table(angles, job), _summarise(recording, angles, job, rectified, rolling))


def _measure(path: Path, markers: MarkerTable, job: MeasureAnglesJob) -> Angles:
    """Each step in turn: what the tracker trusts, the arms, the motion, its quality, its constants."""
    rate = markers.rate_hz
    tracked, reason = trust_tracker(markers)
    _require(path, tracked, reason, markers, job)
    if not np.isfinite(markers.pivot).any():
        raise InputError(path, "no frame has a pivot", "check the tracking")
    arms = find_arms(markers, tracked, job)
    off = tracked & arms.off
    reason[off] = "arm_length"
    fitting = tracked & ~off
    _require(path, fitting, reason, markers, job)
    window_s, order = job.smoothing_window_s, job.smoothing_order
    how = Smoothing(
        order=order,
        window=None if window_s is None else window_frames(window_s, order, rate),
        longest_gap=max(0, min(job.max_gap_frames, int(np.ceil(np.pi * rate / job.max_speed)) - 2)),
        sigmas=job.outlier_sigmas,
        floor=np.deg2rad(job.outlier_floor_deg),
    )
    noise, length_std = measure_noise(arms.lengths, fitting, how.window or longest_window(order, rate))
    marker_std = marker_noise(length_std, markers.pivot, arms.pivot)
    theta = np.where(fitting[:, None], arms.angles(job.rotation_deg), np.nan)
    measured = _explain(path, markers, arms, theta, reason, noise, how, job)
    share = measured[-1].share(noise) if measured[-1] is not None and markers.interpolation is None else np.ones(2)
    if (share < 1).any():  # the lengths vary by more than the angles err
        noise = replace(noise, std=share * noise.std)
        measured = _explain(path, markers, arms, theta, reason, noise, how, job)
    motion, quality, reason, implied, off = measured
    of_both = single_energy(motion.y[:, 0], motion.y[:, 2], implied.fit.constants.G1) if job.single else None
    level = energy(motion.y, implied.fit.constants) if of_both is None else of_both
    angles = Angles(
        markers, arms, tracked, fitting, noise, length_std, marker_std, motion, quality, reason, implied, level, off
    )
    unexplained = angles.unexplained
    if unexplained is None:
        return angles
    return replace(angles, motion=with_errors(motion, unexplained.error(motion.y[:, 2:]), order, rate))


def _explain(
    path: Path,
    markers: MarkerTable,
    arms: Arms,
    theta: np.ndarray,
    reason: np.ndarray,
    noise: Noise,
    how: Smoothing,
    job: MeasureAnglesJob,
) -> tuple[Motion, np.ndarray, np.ndarray, Implied, Misfit | None]:
    """Motion, quality and reason of each frame, what the motion implies, and what no pendulum explains of it."""
    rate = markers.rate_hz
    motion = smooth_motion(theta, rate, noise, how)
    quality, reason = judge(motion, np.isfinite(theta).all(1), reason, arms.borrowed)
    good = quality == MEASURED
    reason[good & markers.corrected] = CORRECTED
    _require(path, good, reason, markers, job)
    try:
        states = np.where(good[:, None], motion.y, np.nan)
        if job.single:
            implied = explain_single(states[:, [0, 2]], rate)
        else:
            implied = explain(states, rate, job.arm1_m, job.rotation_deg)
    except InputError as error:
        if good.mean() > FEW and not is_crowded(angles_of(markers.places)):
            raise InputError(path, str(error)) from error
        why, remedy = _too_few(good, reason, markers, job)
        problem = f"{str(error).partition('; ')[0]}; {int(good.sum())} of {len(good)} frames are usable: {why}"
        raise InputError(path, problem, remedy) from error
    motion = with_motion_between(motion, implied.fit, noise, rate)
    seen = np.where(good[:, None], motion.raw, np.nan)
    angle_std = np.broadcast_to(noise.std, seen.shape)
    if markers.interpolation is not None:
        angle_std = np.hypot(angle_std, fill_errors(markers.interpolation))
        motion = with_errors(motion, markers.interpolation, how.order, rate)
    return motion, quality, reason, implied, misfit(seen, motion.y, angle_std, implied.fit, rate, job.single)


def angles_of(places: np.ndarray) -> np.ndarray:
    """Angles (n, 2) in rad of arms between places (n, 3, 2), 0 where y grows; NaN where one is missing."""
    vectors = np.diff(places, axis=1)
    return np.arctan2(vectors[..., 0], vectors[..., 1])


def _too_few(usable: np.ndarray, reason: np.ndarray, markers: MarkerTable, job: MeasureAnglesJob) -> tuple[str, str]:
    """Why they are, and what helps; a frame that is interpolated has the reason for which it had to be."""
    own = np.where((reason == "interpolated") & (markers.reason != ""), markers.reason, reason)
    return too_few(own, usable, angles_of(markers.places), markers.rate_hz, job.max_gap_frames)


def _require(path: Path, usable: np.ndarray, reason: np.ndarray, markers: MarkerTable, job: MeasureAnglesJob) -> None:
    """Refuse a recording with too few usable frames, and say why they are so few."""
    rate = markers.rate_hz
    wanted = max(FEWEST, job.min_usable_s * rate)
    if usable.sum() < wanted:
        why, remedy = _too_few(usable, reason, markers, job)
        problem = f"{int(usable.sum())} of {len(usable)} frames are usable, {int(np.ceil(wanted))} are needed: {why}"
        raise InputError(path, problem, remedy)


def _table(angles: Angles, job: MeasureAnglesJob) -> pd.DataFrame:
    columns = {"frame": angles.markers.frame, "t": angles.markers.t}
    columns |= {name: angles.motion.y[:, k] for k, name in enumerate(STATE)}
    columns |= {"energy": angles.energy, "quality": angles.quality, "reason": angles.reason}
    raw, std = angles.raw(job.rotation_deg), angles.std(job)
    columns |= {f"{name}_raw": raw[:, k] for k, name in enumerate(STATE[:2])}
    columns |= {f"{name}_unsmoothed": angles.motion.raw[:, k] for k, name in enumerate(STATE[:2])}
    columns |= {f"{name}_std": std[:, k] for k, name in enumerate(STATE)}
    columns |= {f"{name}_px": angles.arms.lengths[:, k] for k, name in enumerate(("arm1", "arm2"))}
    columns |= {f"{name}_std": std for name, std in zip(("pivot", "joint", "tip"), angles.marker_std, strict=True)}
    if job.single:
        columns |= {name: np.full(len(angles.quality), np.nan) for name in columns if name.startswith(SECOND)}
    return pd.DataFrame({**columns, "source": angles.markers.source})


def _summarise(
    name: str, angles: Angles, job: MeasureAnglesJob, rectified: Rectified | None, rolling: Rolling | None
) -> RecordingSummary:
    arms, fit, tilt = angles.arms, angles.implied.fit, angles.implied.tilt_deg
    rate, rotation = angles.markers.rate_hz, job.rotation_deg
    good = angles.quality == MEASURED
    gaps = gap_lengths(angles.quality != UNUSABLE)
    uncertain = np.nanmedian(angles.std(job)[good], axis=0)
    second = max(1, round(rate))
    return RecordingSummary(
        recording=name,
        pendulum="single" if job.single else "double",
        frames=len(good),
        duration_s=len(good) / rate,
        tracked_share=float(angles.tracked.mean()),
        usable_share=float(good.mean()),
        arm1_px=float(arms.typical[0]),
        arm1_std_px=float(angles.length_std[0]),
        arm2_px=float(arms.typical[1]),
        arm2_std_px=float(angles.length_std[1]),
        pivot_x_px=float(np.median(arms.pivot[:, 0])),
        pivot_y_px=float(np.median(arms.pivot[:, 1])),
        noise1_deg=float(np.rad2deg(angles.noise.std[0])),
        noise2_deg=float(np.rad2deg(angles.noise.std[1])),
        uncertainty1_deg=float(np.rad2deg(uncertain[0])),
        uncertainty2_deg=float(np.rad2deg(uncertain[1])),
        uncertainty1_rad_s=float(uncertain[2]),
        uncertainty2_rad_s=float(uncertain[3]),
        offsets_px=arms.offsets.sizes,
        pivot_window_s=arms.window_s if arms.window_s < STILL_S else None,
        unsmoothed_share=tuple(angles.motion.unsmoothed[good].mean(0).tolist()),
        gaps=len(gaps),
        longest_gap_frames=max(gaps, default=0),
        interpolated=int((angles.reason == "interpolated").sum()),
        rejected_arm_length=int((angles.tracked & ~angles.fitting).sum()),
        rejected_outlier=int((angles.reason == "outlier").sum()),
        reasons=dict(sorted(Counter(text for text in angles.reason if text).items())),
        timing=TimingSummary(**asdict(angles.markers.timing)),
        span_s=job.span_s,
        rectified=None if rectified is None else RectifiedSummary(**asdict(rectified)),
        rolling_row_us=None if rolling is None else 1e6 * rolling.row_s,
        rate_hz=rate,
        rate_provenance=job.rate_provenance,
        implied_rate_hz=angles.implied.rate_hz,
        rotation_deg=rotation,
        implied_rotation_deg=None if tilt is None else rotation + tilt,
        rotation_error_deg=float(np.rad2deg(angles.direction_error(job))),
        warnings=[
            *contradictions(angles.implied, rate, job.rate_provenance, job.arm1_m, rotation),
            *_doubts(angles, uncertain, job),
            *_describe_unexplained(angles, job.single),
            *([] if rolling is None else [rolling.warning]),
            *angles.markers.timing.doubts(len(angles.markers)),
        ],
        constants=fit.constants.to_dict(),
        friction=fit.friction,
        misfit_deg=None if angles.off is None else tuple(np.rad2deg(angles.off.rms).tolist()),
        r2_1=fit.r2[0],
        r2_2=fit.r2[1],
        energy_start=float(np.median(angles.energy[good][:second])),
        energy_end=float(np.median(angles.energy[good][-second:])),
    )


def _doubts(angles: Angles, uncertain: np.ndarray, job: MeasureAnglesJob) -> list[str]:
    """Where polynomials do not follow the motion, in plain words."""
    good = angles.quality == MEASURED
    rate, window_s = angles.markers.rate_hz, job.smoothing_window_s
    if window_s is not None:
        worse = np.sqrt(np.nanmean(angles.motion.std[good, :2] ** 2, axis=0)) / angles.noise.std
        if worse.max() <= MOST_WORSE:
            return []
        return [
            f"smoothing over {window_s:g} s makes the angles up to {worse.max():.1f} times as uncertain as the markers:"
            " leave out recordings.angles.smoothing_window_s"
        ]
    share = angles.motion.unsmoothed[good].mean(0)
    if share.max() <= MOST_UNSMOOTHED:
        return []
    return [
        f"the motion is too fast for polynomials at {rate:g} Hz: {share.max():.0%} of the angles are as measured, and"
        f" the speeds are uncertain by {uncertain[2]:.2g} and {uncertain[3]:.2g} rad/s in the median"
    ]


def _describe_unexplained(angles: Angles, single: bool) -> list[str]:
    """That no pendulum moves so, in plain words, and what may be the cause."""
    off, r2 = angles.off, angles.implied.fit.r2
    shown = slice(0, 1) if single else slice(0, 2)
    if off is None:
        if min(r2) >= LEAST_R2:
            return []
        return [
            f"the pendulum explains a share of {_list(r2[shown], '.2f')} of the motion (R²) and no stretch is long"
            " enough to tell the angles' errors: take their uncertainties for too small"
        ]
    if not off.beyond:
        return []
    late = 1000 * np.sqrt(off.timing[shown].min())  # one time is wrong for both
    times = f", as if frames were off their times by {late:.1f} ms" if late > LATE_MS else ""
    return [
        f"the angles are off any pendulum's motion by {_list(np.rad2deg(off.rms[shown]), '.2g')}° rms{times} (R²"
        f" {_list(r2[shown], '.2f')}), their markers by {_list(np.rad2deg(off.known[shown]), '.2g')}°: the"
        " uncertainties were widened to that; use the original if the video was converted to another frame rate, and"
        " check arms and view"
    ]


def _list(values: Sequence[float], form: str) -> str:
    return " and ".join(format(value, form) for value in values)
