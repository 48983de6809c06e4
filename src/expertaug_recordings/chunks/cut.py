"""Chunks of the recordings' motion, split into train, validation and test by energy or by time."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from expertaug.errors import InputError
from expertaug.files import atomic, write_json
from expertaug.measurements.chunks import chosen, rows_of, stride_of
from expertaug.measurements.paths import natural_key
from expertaug.measurements.splitting import SPLITS, keep_apart, label_by_level, label_by_time
from expertaug.systems.double_pendulum import energy
from expertaug.trajectories import Trajectories
from expertaug_recordings.angles.pendulum_fit import Fit, fit_constants
from expertaug_recordings.angles.quality import MEASURED
from expertaug_recordings.angles.single import fit_single, single_energy
from expertaug_recordings.settings import SplitChunksJob
from expertaug_recordings.tables import read_table

STATE = ("theta1", "theta2", "omega1", "omega2")
SINGLE = ("theta1", "omega1")  # of a single pendulum
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Recording:
    """One recording's angles: frame numbers (n,), states (n, 4), measured frames (n,) and frames per second."""

    name: str
    frame: np.ndarray
    y: np.ndarray
    measured: np.ndarray
    rate_hz: float


@dataclass(frozen=True)
class Division:
    """Which split each frame of the recordings belongs to.

    Attributes:
        recordings: in natural order of their names.
        steps: of each, frames from one point of a chunk to the next.
        energies: of each, (n,) in s⁻².
        labels: of each, (n,): 0 train, 1 validation, 2 test, -1 none.
        fit: the constants of the energies.
        thresholds: of the energies in s⁻², where they divide.
    """

    recordings: list[Recording]
    steps: list[int]
    energies: list[np.ndarray]
    labels: list[np.ndarray]
    fit: Fit
    thresholds: dict[str, float] | None


def split_chunks(angles: Sequence[str | Path], output_dir: str | Path, job: SplitChunksJob) -> None:
    """Cut the recordings into chunks and split them; no frame is in two splits.

    A chunk spans only frames that were measured (quality 1), also those between its points.

    Arguments:
        angles: the ``angles.csv`` of each recording, named by its folder, in any order.
        output_dir: gets train.npz, validation.npz, test.npz (:class:`Trajectories`: t from 0 in s,
            y (N, length, 4) with the first angles in (−π, π], z_e the initial speeds, id recording and first frame),
            chunks.csv and splits.json.
        job: its settings.

    Raises:
        InputError: a bad table, a rate that is no multiple of ``rate_hz``, or a split with too few chunks.
    """
    output_dir = Path(output_dir)
    division = divide(angles, output_dir, job)
    _write(output_dir, division, _choose(output_dir, division, job), job)


def divide(angles: Sequence[str | Path], output: Path, job: SplitChunksJob) -> Division:
    """Read the recordings and say of each frame which split it belongs to; ``output`` is for messages.

    Raises:
        InputError: as :func:`split_chunks`.
    """
    recordings = sorted(
        (_read_angles(Path(path), SINGLE if job.single else STATE) for path in angles),
        key=lambda r: natural_key(r.name),
    )
    names = [r.name for r in recordings]
    if not recordings or len(set(names)) < len(names):
        raise InputError(output, f"recordings are {names}", "give the angles of recordings with different names")
    steps = [_step(r, job) for r in recordings]
    fit = _pooled_fit(recordings, steps, job)
    if job.single:
        energies = [single_energy(*r.y.T, fit.constants.G1) for r in recordings]
    else:
        energies = [energy(r.y, fit.constants) for r in recordings]
    measured = [r.measured for r in recordings]
    if job.by == "time":
        labels, thresholds = [label_by_time(m, job.shares) for m in measured], None
    else:
        sizes = [job.length * step for step in steps]
        labels, thresholds = label_by_level(measured, energies, sizes, job.shares)
    labels = [keep_apart(label, round(job.guard_s * r.rate_hz)) for label, r in zip(labels, recordings, strict=True)]
    return Division(recordings, steps, energies, labels, fit, thresholds)


def _choose(output_dir: Path, division: Division, job: SplitChunksJob) -> dict[str, np.ndarray]:
    """Per split, rows (recording, first row of the chunk), (N, 2)."""
    each = {name: _enough(division, name, job) for name in SPLITS}
    return chosen(output_dir, each, job, "recordings")


def _enough(division: Division, split: str, job: SplitChunksJob) -> np.ndarray:
    """A split's chunks, (N, 2): as far apart as the settings say, or nearer where these are too few.

    Recordings of some hundred frames would otherwise be refused for a stride that nobody chose for them.
    """
    wanted = stride = stride_of(split, job)
    rows = rows_of(division.labels, division.steps, split, job, stride)
    while len(rows) < job.min_chunks and stride > 1:
        stride //= 2
        rows = rows_of(division.labels, division.steps, split, job, stride)
    if stride < wanted and len(rows) >= job.min_chunks:
        text = "the %s split's chunks begin every %d points instead of every %d, for there to be %d%s"
        overlap = ": they overlap, and intervals of its scores are too narrow" if stride < job.length else ""
        logger.warning(text, split, stride, wanted, job.min_chunks, overlap)
    return rows


def _pooled_fit(recordings: list[Recording], steps: list[int], job: SplitChunksJob) -> Fit:
    """Constants fitted on all recordings together; they only rank segments by energy, no model sees them."""
    series = [np.where(r.measured[:, None], r.y, np.nan) for r in recordings]
    # Each phase of each recording is a series at the chunks' rate; they are padded with NaN to one length.
    phases = [y[k::step] for y, step in zip(series, steps, strict=True) for k in range(step)]
    padded = np.full((len(phases), max(len(p) for p in phases), series[0].shape[1]), np.nan)
    for row, phase in zip(padded, phases, strict=True):
        row[: len(phase)] = phase
    if job.single:
        return fit_single(padded, job.rate_hz)[0]
    return fit_constants(padded, 1 / job.rate_hz, friction=True)


def _step(recording: Recording, job: SplitChunksJob) -> int:
    step = recording.rate_hz / job.rate_hz
    if step < 0.999 or abs(step - round(step)) > 1e-3:
        found = f"rate_hz is {job.rate_hz:g}, recording {recording.name} has {recording.rate_hz:g} Hz"
        raise InputError("chunks settings", found, "the second must be a multiple of the first")
    return round(step)


def _read_angles(path: Path, state: Sequence[str]) -> Recording:
    table = read_table(path, ("frame", "t", *state, "quality"))
    t, y, quality = table["t"].to_numpy(), table[list(state)].to_numpy(), table["quality"].to_numpy()
    if len(t) < 10 or not t[-1] > t[0]:
        raise InputError(path, f"{len(t)} frames", "run measure_angles again")
    rate = (len(t) - 1) / (t[-1] - t[0])
    measured = (quality == MEASURED) & np.isfinite(y).all(1)
    return Recording(path.parent.name, table["frame"].to_numpy(), y, measured, float(rate))


def trajectories_of(division: Division, rows: np.ndarray, job: SplitChunksJob) -> Trajectories:
    """The chunks (N, 2) of :func:`rows_of`, with the first angles in (−π, π].

    Their z_e are the initial speeds; of a single pendulum the ω0 that a fit of its whole recording finds.
    """
    y, identity = [], []
    for (index, first), points in zip(rows, _points(division, rows, job), strict=True):
        recording = division.recordings[index]
        y.append(recording.y[points])
        identity.append(f"{recording.name}/{recording.frame[first]}")
    states = np.stack(y)
    # Whole turns before the chunk are of no interest, and single precision would lose digits to them.
    angles = states.shape[2] // 2
    states[..., :angles] -= 2 * np.pi * np.round(states[:, :1, :angles] / (2 * np.pi))
    times = np.arange(job.length) / job.rate_hz
    z_e = states[:, 0, angles:]
    if job.single:
        fits = [fit_single(np.where(r.measured[:, None], r.y, np.nan), r.rate_hz)[0] for r in division.recordings]
        z_e = np.sqrt([fits[index].constants.G1 for index in rows[:, 0]])[:, None]
    return Trajectories(times, states, z_e, id=np.array(identity))


def _points(division: Division, rows: np.ndarray, job: SplitChunksJob) -> np.ndarray:
    """Rows of a recording that each chunk's points are, (N, length)."""
    step = np.array(division.steps)[rows[:, 0]]
    return rows[:, 1:] + step[:, None] * np.arange(job.length)


def _write(output_dir: Path, division: Division, chosen: dict[str, np.ndarray], job: SplitChunksJob) -> None:
    tables, counts, speeds, recordings = [], {}, {}, division.recordings
    for name, rows in chosen.items():
        chunks = trajectories_of(division, rows, job)
        chunks.save(output_dir / f"{name}.npz")
        points = _points(division, rows, job)
        level = [division.energies[index][own].mean() for index, own in zip(rows[:, 0], points, strict=True)]
        counts[name] = {r.name: int((rows[:, 0] == k).sum()) for k, r in enumerate(recordings)}
        speeds[name] = np.quantile(np.abs(chunks.y[:, 0, chunks.y.shape[2] // 2 :]), 0.99, axis=0).round(3).tolist()
        tables.append(
            pd.DataFrame(
                {
                    "chunk": np.arange(len(rows)),
                    "recording": [recordings[index].name for index in rows[:, 0]],
                    "first_frame": [recordings[index].frame[first] for index, first in rows],
                    "split": name,
                    "energy": level,
                }
            )
        )
    with atomic(output_dir / "chunks.csv") as temporary:
        pd.concat(tables).to_csv(temporary, index=False, float_format="%.7g")
    limits = {name: job.limit(name) for name in SPLITS}
    write_json(
        output_dir / "splits.json",
        {
            "by": job.by,
            "thresholds": division.thresholds,
            "chunks": {name: int(sum(of.values())) for name, of in counts.items()},
            "recordings": counts,
            "initial_speeds_p99": speeds,
            "energy_constants": division.fit.constants.to_dict(),
            "energy_constants_note": "fitted on all recordings; a label to rank chunks by, used by no model",
            "settings": {**job.model_dump(exclude={"horizons_s"}), "max_chunks": limits},
        },
    )
