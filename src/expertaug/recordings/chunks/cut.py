"""Chunks of the recordings' motion, split into train, validation and test by energy or by time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from expertaug.errors import InputError
from expertaug.files import atomic, write_json
from expertaug.recordings.angles.pendulum_fit import Fit, fit_constants
from expertaug.recordings.angles.quality import MEASURED
from expertaug.recordings.angles.smoothing import stretches
from expertaug.recordings.chunks.settings import ChunkSettings
from expertaug.recordings.chunks.splitting import SPLITS, keep_apart, label_by_energy, label_by_time
from expertaug.recordings.names import natural_key
from expertaug.recordings.options import read_settings
from expertaug.recordings.tables import read_table
from expertaug.systems.double_pendulum import energy
from expertaug.trajectories import Trajectories

STATE = ("theta1", "theta2", "omega1", "omega2")


@dataclass(frozen=True)
class Recording:
    """One recording's angles: frame numbers (n,), states (n, 4), measured frames (n,) and frames per second."""

    name: str
    frame: np.ndarray
    y: np.ndarray
    measured: np.ndarray
    rate_hz: float


def split_chunks(
    angles: Sequence[str | Path], output_dir: str | Path, settings: Mapping[str, object] | None = None
) -> None:
    """Cut the recordings into chunks and split them; no frame is in two splits.

    A chunk spans only frames that were measured (quality 1), also those between its points.

    Arguments:
        angles: the ``angles.csv`` of each recording, named by its folder, in any order.
        output_dir: gets train.npz, validation.npz, test.npz (:class:`Trajectories`: t from 0 in s,
            y (N, length, 4) with the first angles in (−π, π], z_e the initial speeds, id recording and first frame),
            chunks.csv and splits.json.
        settings: see :class:`ChunkSettings`.

    Raises:
        InputError: a bad table, a rate that is no multiple of ``rate_hz``, or a split with too few chunks.
    """
    options = read_settings(ChunkSettings, settings, "chunks")
    output_dir = Path(output_dir)
    recordings = sorted((_read_angles(Path(path)) for path in angles), key=lambda r: natural_key(r.name))
    names = [r.name for r in recordings]
    if not recordings or len(set(names)) < len(names):
        raise InputError(output_dir, f"recordings are {names}", "give the angles of recordings with different names")
    steps = [_step(r, options) for r in recordings]
    fit = _pooled_fit(recordings, steps, options)
    energies = [energy(r.y, fit.constants) for r in recordings]
    measured = [r.measured for r in recordings]
    if options.by == "time":
        labels, thresholds = [label_by_time(m, options.shares) for m in measured], None
    else:
        sizes = [options.length * step for step in steps]
        labels, thresholds = label_by_energy(measured, energies, sizes, options.shares)
    labels = [
        keep_apart(label, round(options.guard_s * r.rate_hz)) for label, r in zip(labels, recordings, strict=True)
    ]
    chosen = _choose(output_dir, labels, steps, options)
    _write(output_dir, recordings, energies, steps, chosen, options, fit, thresholds)


def _choose(
    output_dir: Path, labels: list[np.ndarray], steps: list[int], options: ChunkSettings
) -> dict[str, np.ndarray]:
    """Per split, rows (recording, first row of the chunk), (N, 2)."""
    chosen = {}
    for split, name in enumerate(SPLITS):
        stride = options.stride if name == "train" else options.evaluation_stride
        starts = [
            chunk_starts(label == split, step, options, stride) for label, step in zip(labels, steps, strict=True)
        ]
        recording = np.repeat(np.arange(len(starts)), [len(s) for s in starts])
        chosen[name] = np.stack((recording, np.concatenate(starts)), axis=1)
    for name, rows in chosen.items():
        if len(rows) < options.min_chunks:
            counts = ", ".join(f"{n} {len(of)}" for n, of in chosen.items())
            remedy = (
                f"at least {options.min_chunks} are needed: more recordings, a smaller stride or a lower min_chunks"
            )
            raise InputError(output_dir, f"too few chunks for the {name} split ({counts})", remedy)
        limit = options.limit(name)
        if limit is not None and limit < len(rows):
            chosen[name] = rows[np.linspace(0, len(rows) - 1, limit).round().astype(int)]
    return chosen


def chunk_starts(member: np.ndarray, step: int, options: ChunkSettings, stride: int) -> np.ndarray:
    """First rows of the chunks that lie wholly in runs of ``member`` rows, in order."""
    span = (options.length - 1) * step + 1
    starts = [np.zeros(0, dtype=int)]
    for start, stop in stretches(member):
        phases = range(step if options.phases == "all" else 1)
        starts += [np.arange(start + phase, stop - span + 1, stride * step) for phase in phases]
    return np.sort(np.concatenate(starts))


def _pooled_fit(recordings: list[Recording], steps: list[int], options: ChunkSettings) -> Fit:
    """Constants fitted on all recordings together; they only rank segments by energy, no model sees them."""
    series = [np.where(r.measured[:, None], r.y, np.nan) for r in recordings]
    # Each phase of each recording is a series at the chunks' rate; they are padded with NaN to one length.
    phases = [y[k::step] for y, step in zip(series, steps, strict=True) for k in range(step)]
    padded = np.full((len(phases), max(len(p) for p in phases), 4), np.nan)
    for row, phase in zip(padded, phases, strict=True):
        row[: len(phase)] = phase
    return fit_constants(padded, 1 / options.rate_hz, friction=True)


def _step(recording: Recording, options: ChunkSettings) -> int:
    step = recording.rate_hz / options.rate_hz
    if step < 0.999 or abs(step - round(step)) > 1e-3:
        found = f"rate_hz is {options.rate_hz:g}, recording {recording.name} has {recording.rate_hz:g} Hz"
        raise InputError("chunks settings", found, "the second must be a multiple of the first")
    return round(step)


def _read_angles(path: Path) -> Recording:
    table = read_table(path, ("frame", "t", *STATE, "quality"))
    t, y, quality = table["t"].to_numpy(), table[list(STATE)].to_numpy(), table["quality"].to_numpy()
    if len(t) < 10 or not t[-1] > t[0]:
        raise InputError(path, f"{len(t)} frames", "run measure_angles again")
    rate = (len(t) - 1) / (t[-1] - t[0])
    measured = (quality == MEASURED) & np.isfinite(y).all(1)
    return Recording(path.parent.name, table["frame"].to_numpy(), y, measured, float(rate))


def _write(
    output_dir: Path,
    recordings: list[Recording],
    energies: list[np.ndarray],
    steps: list[int],
    chosen: dict[str, np.ndarray],
    options: ChunkSettings,
    fit: Fit,
    thresholds: dict[str, float] | None,
) -> None:
    tables, counts, speeds = [], {}, {}
    times = np.arange(options.length) / options.rate_hz
    for name, rows in chosen.items():
        y, level, first = [], [], []
        for index, recording in enumerate(recordings):
            starts = rows[rows[:, 0] == index, 1]
            points = starts[:, None] + steps[index] * np.arange(options.length)
            y.append(recording.y[points])
            level.append(energies[index][points].mean(1))
            first.append(recording.frame[starts])
        counts[name] = {r.name: len(part) for r, part in zip(recordings, y, strict=True)}
        y = np.concatenate(y)
        # Whole turns before the chunk are of no interest, and single precision would lose digits to them.
        y[..., :2] -= 2 * np.pi * np.round(y[:, :1, :2] / (2 * np.pi))
        speeds[name] = np.quantile(np.abs(y[:, 0, 2:]), 0.99, axis=0).round(3).tolist()
        names, frames = [recordings[i].name for i in rows[:, 0]], np.concatenate(first)
        identity = np.array([f"{recording}/{frame}" for recording, frame in zip(names, frames, strict=True)])
        Trajectories(times, y, y[:, 0, 2:], id=identity).save(output_dir / f"{name}.npz")
        tables.append(
            pd.DataFrame(
                {
                    "chunk": np.arange(len(y)),
                    "recording": names,
                    "first_frame": frames,
                    "split": name,
                    "energy": np.concatenate(level),
                }
            )
        )
    with atomic(output_dir / "chunks.csv") as temporary:
        pd.concat(tables).to_csv(temporary, index=False, float_format="%.7g")
    limits = {name: options.limit(name) for name in SPLITS}
    write_json(
        output_dir / "splits.json",
        {
            "by": options.by,
            "thresholds": thresholds,
            "chunks": {name: int(sum(of.values())) for name, of in counts.items()},
            "recordings": counts,
            "initial_speeds_p99": speeds,
            "energy_constants": fit.constants.to_dict(),
            "energy_constants_note": "fitted on all recordings; a label to rank chunks by, used by no model",
            "settings": {**options.model_dump(), "max_chunks": limits},
        },
    )
