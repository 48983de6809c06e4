"""Forecasts of a recording's chunks, found again by the states from which they start."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from expertaug.errors import InputError

ANGLES = ("theta1", "theta2")
SAME = 1e-3  # rad by which a chunk's first angles may differ from the table's


@dataclass(frozen=True)
class Forecast:
    """Forecast angles (n, 2) in rad at the rows (n,) of a recording, by the method of this label."""

    label: str
    rows: np.ndarray
    theta: np.ndarray

    def at(self, row: int) -> np.ndarray:
        """Angles (2,) at a row between the first and the last."""
        return np.array([np.interp(row, self.rows, self.theta[:, k]) for k in range(2)])


def read_forecasts(
    files: Mapping[str, str | Path], chunks: str | Path | None, angles: str | Path, recording: str
) -> list[Forecast]:
    """Those forecasts that are of a recording, in order of time; by each method's first seed.

    Arguments:
        files: forecasts.npz (:mod:`expertaug.evaluation.evaluate`) by the method's label.
        chunks: chunks.csv that says of which recording and frame each chunk is.
        angles: angles.csv of the recording.
        recording: its name.

    Raises:
        InputError: a file is missing or cannot be used.
    """
    if not files or chunks is None:
        return []
    listed = _table(chunks, {"recording": str})
    table = _table(angles, {"reason": str})
    wanted = [("recording", "first_frame", "split"), ("frame", "t", *ANGLES)]
    for path, found, columns in ((chunks, listed, wanted[0]), (angles, table, wanted[1])):
        if missing := [c for c in columns if c not in found]:
            raise InputError(path, f"column {missing[0]} is missing", "make it again")
    listed = listed[listed["recording"] == recording]
    return sorted(
        (f for label, path in files.items() for f in _of_method(label, Path(path), listed, table)),
        key=lambda f: int(f.rows[0]),
    )


def _table(path: str | Path, kinds: Mapping[str, type]) -> pd.DataFrame:
    try:
        return pd.read_csv(path, dtype=dict(kinds))
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "run the stage that makes it") from error
    except (ValueError, OSError) as error:
        raise InputError(path, f"not a table ({error})", "make it again") from error


def _of_method(label: str, path: Path, listed: pd.DataFrame, table: pd.DataFrame) -> list[Forecast]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            names = [str(name) for name in archive["state_names"]]
            t = archive["t"]
            sets = {
                name.removesuffix("_truth"): (archive[name], archive[f"{name.removesuffix('_truth')}_prediction"][0])
                for name in archive.files
                if name.endswith("_truth")
            }
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "run evaluate") from error
    except (KeyError, IndexError, ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise InputError(path, f"not a forecast file ({error})", "make it again with evaluate") from error
    if not set(ANGLES) <= set(names):
        return []
    columns = [names.index(name) for name in ANGLES]
    frame, own = table["frame"].to_numpy(), table[list(ANGLES)].to_numpy(float)
    found = []
    for name, (truth, prediction) in sets.items():
        starts = np.searchsorted(frame, listed.loc[listed["split"] == name, "first_frame"].to_numpy())
        rate = (len(table) - 1) / float(table["t"].iloc[-1] - table["t"].iloc[0])
        rows = np.rint((t - t[0]) * rate).astype(int)
        for first, angles in zip(truth[:, 0, columns], prediction[..., columns], strict=True):
            off = np.abs(np.angle(np.exp(1j * (own[starts] - first)))).max(1) if len(starts) else np.ones(1)
            if off.min() < SAME:
                found.append(Forecast(label, int(starts[int(off.argmin())]) + rows, angles.astype(float)))
    return found
