"""Chunks of the recordings' motion: their angles as measurements, which are cut and divided as all others are.

What is particular of recordings is the quantity by which they may be divided: their energy, with constants fitted to
all of them together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from expertaug.errors import InputError
from expertaug.files import atomic, write_json
from expertaug.measurements.cut import Divided, Measured, Source, sets_of
from expertaug.measurements.grid import Grid, Series
from expertaug.measurements.horizons import long_set
from expertaug.measurements.names import Names
from expertaug.measurements.paths import natural_key
from expertaug.measurements.settings import Cutting, MeasurementSettings, SplitSettings
from expertaug.measurements.splitting import SPLITS
from expertaug.measurements.trajectory import Rows
from expertaug.systems.double_pendulum import energy
from expertaug.trajectories import Trajectories
from expertaug_recordings.angles.pendulum_fit import Fit, fit_constants, fit_single, single_energy
from expertaug_recordings.angles.quality import MEASURED
from expertaug_recordings.settings import CutHorizonJob, SplitChunksJob
from expertaug_recordings.tables import read_table

STATE = {"theta1": "rad", "theta2": "rad", "omega1": "rad/s", "omega2": "rad/s"}
SINGLE = ("theta1", "omega1")  # of a single pendulum
RECORDED = Source("data.split", "data.split", "recordings", "frames", "recordings", "longer recordings")


@dataclass(frozen=True)
class Recording:
    """One recording's angles: its file, frame numbers (n,), states (n, K), measured frames (n,), frames per second."""

    path: Path
    frame: np.ndarray
    y: np.ndarray
    measured: np.ndarray
    rate_hz: float

    @property
    def name(self) -> str:
        return self.path.parent.name

    @property
    def known(self) -> np.ndarray:
        """States (n, K), NaN where they were not measured."""
        return np.where(self.measured[:, None], self.y, np.nan)


@dataclass(frozen=True)
class Splits:
    """Chunks of recordings, divided.

    Attributes:
        sets: train, validation and test (:class:`Trajectories`: t from 0 in s, y (N, length, 4) with the first angles
            in (−π, π], z_e the initial speeds, id recording and first frame; of a single pendulum y (N, length, 2) and
            z_e the ω0 that a fit of its whole recording finds).
        chunks: a row for each chunk: of which recording and set, its first frame and its mean energy.
        described: what splits.json says of them.
    """

    sets: Mapping[str, Trajectories]
    chunks: pd.DataFrame
    described: Mapping[str, object]


def split_chunks(angles: Sequence[str | Path], output_dir: str | Path, job: SplitChunksJob) -> None:
    """Stage: cut the recordings into chunks and split them; no frame is in two splits.

    Arguments:
        angles: the ``angles.csv`` of each recording, named by its folder, in any order.
        output_dir: gets train.npz, validation.npz, test.npz, chunks.csv and splits.json: those of :class:`Splits`.
        job: its settings.

    Raises:
        InputError: a bad table, or as of :func:`split_recordings`.
    """
    folder, splits = Path(output_dir), split_recordings(read_recordings(angles, job.single), job)
    for name, chunks in splits.sets.items():
        chunks.save(folder / f"{name}.npz")
    with atomic(folder / "chunks.csv") as temporary:
        splits.chunks.to_csv(temporary, index=False, float_format="%.7g")
    write_json(folder / "splits.json", dict(splits.described))


def split_recordings(recordings: Iterable[Recording], job: SplitChunksJob) -> Splits:
    """Cut recordings into chunks and split them; no frame is in two splits.

    A chunk spans only frames that were measured (quality 1), also those between its points.

    Raises:
        InputError: as of :func:`as_measured`, or a split with too few chunks.
    """
    data, fit = as_measured(recordings, job)
    divided = sets_of(data)
    return Splits(divided.sets, _chunks(data, divided, job), _describe(data, divided, fit, job))


def cut_horizon(angles: Sequence[str | Path], output: str | Path, job: CutHorizonJob) -> None:
    """Stage: cut a set of long chunks out of the frames of a split, evenly spread.

    Arguments:
        angles: as of :func:`split_chunks`, which divides the frames in the same way.
        output: gets the set (:class:`Trajectories`), as that function's sets but for its times.
        job: which set, and how the frames were divided.

    Raises:
        InputError: a bad table, or no stretch of the split's frames is as long as that.
    """
    recordings = read_recordings(angles, job.split.single)
    long_set(as_measured(recordings, job.split)[0], job.set).save(Path(output))


def read_recordings(angles: Sequence[str | Path], single: bool = False) -> list[Recording]:
    """Recordings' angles.

    Arguments:
        single: whether they are of a single pendulum.

    Raises:
        InputError: a bad table.
    """
    return [_read(Path(path), SINGLE if single else tuple(STATE)) for path in angles]


def as_measured(recordings: Iterable[Recording], job: SplitChunksJob) -> tuple[Measured, Fit]:
    """Recordings in natural order of their names as measurements, with each frame's energy in s⁻² as the quantity that
    divides them; and the constants of these energies, fitted to all recordings: no model sees them.

    Raises:
        InputError: two recordings of one name, or rates that are no multiple of ``rate_hz``, or several.
    """
    state = SINGLE if job.single else tuple(STATE)
    ordered = sorted(recordings, key=lambda recording: natural_key(recording.name))
    names = [recording.name for recording in ordered]
    if not ordered or len(set(names)) < len(names):
        raise InputError("angles", f"recordings are {names}", "give the angles of recordings with different names")
    step = _step(ordered, job)
    fit = _fit(ordered, step, job)
    row_s = 1 / (job.rate_hz * step)
    series = [_series(recording, row_s, _energy(recording, fit, job), job.single) for recording in ordered]
    settings = _as_measurements(ordered, state, job)
    units = {name: STATE[name] for name in state}
    parameters = {"omega0": "rad/s"} if job.single else {name: STATE[name] for name in settings.z_e}
    grid = Grid(series, row_s, step, 0, None, rate_hz=job.rate_hz)
    files = [recording.path for recording in ordered]
    return Measured(files, Names(units, parameters), settings, grid, None, RECORDED, nearer=True), fit


def _read(path: Path, state: Sequence[str]) -> Recording:
    table = read_table(path, ("frame", "t", *state, "quality"))
    t, y, quality = table["t"].to_numpy(), table[list(state)].to_numpy(), table["quality"].to_numpy()
    if len(t) < 10 or not t[-1] > t[0]:
        raise InputError(path, f"{len(t)} frames", "run measure_angles again")
    rate = (len(t) - 1) / (t[-1] - t[0])
    measured = (quality == MEASURED) & np.isfinite(y).all(1)
    return Recording(path, table["frame"].to_numpy(), y, measured, float(rate))


def _step(recordings: Sequence[Recording], job: SplitChunksJob) -> int:
    """Frames from one point of a chunk to the next."""
    steps = {}
    for recording in recordings:
        step = recording.rate_hz / job.rate_hz
        if step < 0.999 or abs(step - round(step)) > 1e-3:
            problem = f"rate_hz is {job.rate_hz:g}, recording {recording.name} has {recording.rate_hz:g} Hz"
            raise InputError("chunks settings", problem, "the second must be a multiple of the first")
        steps.setdefault(round(step), recording)
    if len(steps) > 1:
        problem = " and ".join(f"{example.name} has {example.rate_hz:g} Hz" for example in list(steps.values())[:2])
        raise InputError("angles", problem, "measure the angles of all at one rate (recordings.analysis_rate_hz)")
    return next(iter(steps))


def _fit(recordings: Sequence[Recording], step: int, job: SplitChunksJob) -> Fit:
    """Constants of all recordings together."""
    # Each phase of each recording is a series at the chunks' rate; they are padded with NaN to one length.
    phases = [r.known[k::step] for r in recordings for k in range(step)]
    padded = np.full((len(phases), max(len(p) for p in phases), phases[0].shape[1]), np.nan)
    for row, phase in zip(padded, phases, strict=True):
        row[: len(phase)] = phase
    if job.single:
        return fit_single(padded, job.rate_hz)[0]
    return fit_constants(padded, 1 / job.rate_hz, friction=True)


def _energy(recording: Recording, fit: Fit, job: SplitChunksJob) -> np.ndarray:
    """Of each frame in s⁻², (n,)."""
    y, constants = recording.y, fit.constants
    return single_energy(*y.T, constants.G1) if job.single else energy(y, constants)


def _series(recording: Recording, row_s: float, level: np.ndarray, single: bool) -> Series:
    """A recording's frames as points of a grid."""
    n, y, rate = len(recording.frame), recording.y, recording.rate_hz
    t, none = np.arange(n) * row_s, np.zeros((n, 0))
    z_e = np.sqrt([fit_single(recording.known, rate)[0].constants.G1]) if single else np.full(2, np.nan)
    rows = Rows(recording.name, recording.path, recording.frame, t, y, none, z_e, level, None, 0)
    return Series(rows, t, np.arange(n), y, none, recording.measured, level, None)


def _as_measurements(recordings: Sequence[Recording], state: Sequence[str], job: SplitChunksJob) -> MeasurementSettings:
    """The job's settings as those of measurements: a chunk has no gap, and z_e are a double pendulum's first speeds."""
    divided = {"by": "quantity", "quantity": "energy"} if job.by == "energy" else {"by": "time", "reverse": True}
    shares = {f"{name}_share": share for name, share in zip(SPLITS, job.shares, strict=True)}
    return MeasurementSettings(
        **{name: getattr(job, name) for name in Cutting.model_fields},
        paths=[str(r.path) for r in recordings],
        columns={name: name for name in state},
        angles=[name for name in state if name.startswith("theta")],
        z_e={} if job.single else {name: {"start": name} for name in state if name.startswith("omega")},
        step_s=1 / job.rate_hz,
        longest_gap=0,
        min_seen=1.0,
        split=SplitSettings(**divided, **shares, guard_s=job.guard_s),
    )


def _chunks(data: Measured, divided: Divided, job: SplitChunksJob) -> pd.DataFrame:
    """A row for each chunk of each set."""
    series, tables = data.grid.series, []
    ahead = data.grid.step * np.arange(job.length)
    for name, of_set in divided.rows.items():
        recordings, first = [series[index] for index, _ in of_set], of_set[:, 1]
        begins = list(zip(recordings, first, strict=True))
        tables.append(
            pd.DataFrame(
                {
                    "chunk": np.arange(len(first)),
                    "recording": [recording.name for recording in recordings],
                    "first_frame": [recording.rows.line[k] for recording, k in begins],
                    "split": name,
                    "energy": [recording.level[k + ahead].mean() for recording, k in begins],
                }
            )
        )
    return pd.concat(tables)


def _describe(data: Measured, divided: Divided, fit: Fit, job: SplitChunksJob) -> dict[str, object]:
    """What splits.json says."""
    series, counts, speeds = data.grid.series, {}, {}
    for name, chunks in divided.sets.items():
        starts = divided.rows[name][:, 0]
        counts[name] = {recording.name: int((starts == k).sum()) for k, recording in enumerate(series)}
        speeds[name] = np.quantile(np.abs(chunks.y[:, 0, chunks.y.shape[2] // 2 :]), 0.99, axis=0).round(3).tolist()
    return {
        "by": job.by,
        "thresholds": divided.thresholds,
        "chunks": {name: len(chunks) for name, chunks in divided.sets.items()},
        "recordings": counts,
        "initial_speeds_p99": speeds,
        "energy_constants": fit.constants.to_dict(),
        "energy_constants_note": "fitted on all recordings; a label to rank chunks by, used by no model",
        "settings": {
            **job.model_dump(exclude={"horizons_s"}),
            "max_chunks": {name: job.limit(name) for name in SPLITS},
        },
    }
