"""The stage cut_measurements: chunks of measurements as files of sets, and what is known of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from expertaug.files import atomic, sha256, write_json
from expertaug.measurements.cut import Measured, measured, sets_of
from expertaug.measurements.names import Names
from expertaug.measurements.settings import MeasurementSettings
from expertaug.measurements.windows import KEPT
from expertaug.trajectories import Trajectories


def cut_measurements(
    files: Sequence[Path], output_dir: str | Path, settings: MeasurementSettings, names: Names
) -> None:
    """Stage: cut measurements into chunks and divide them into sets.

    Arguments:
        files: those that ``paths`` names, which the workflow follows.
        output_dir: gets train.npz, validation.npz, test.npz, chunks.csv and splits.json.
        settings: how they are read, cut and divided; its ``paths`` give way to the files.
        names: of the system.

    Raises:
        InputError: a file cannot be used, or a set has too few chunks.
    """
    output_dir = Path(output_dir)
    data = measured(settings.of_files(files), names)
    data.warn_of_slopes()
    sets, rows, thresholds = sets_of(data)
    data.warn_of_short()
    for name, trajectories in sets.items():
        trajectories.save(output_dir / f"{name}.npz")
    _write(output_dir, data, sets, rows, thresholds)


def _write(
    output_dir: Path,
    data: Measured,
    sets: Mapping[str, Trajectories],
    rows: Mapping[str, np.ndarray],
    thresholds: dict[str, float] | None,
) -> None:
    series, tables = data.grid.series, []
    for name, of in rows.items():
        identity = sets[name].id
        assert identity is not None
        first = [float(series[index].t[point]) for index, point in of]
        named = {"trajectory": [series[index].name for index, _ in of], "first_s": first}
        tables.append(pd.DataFrame({"chunk": np.arange(len(of)), **named, "id": identity, "split": name}))
    with atomic(output_dir / "chunks.csv") as temporary:
        pd.concat(tables).to_csv(temporary, index=False, float_format="%.9g")
    state = list(data.names.state)

    def by_name(values: np.ndarray | None) -> dict[str, float | None] | None:
        if values is None:
            return None
        return {n: float(v) if np.isfinite(v) else None for n, v in zip(state, values, strict=True)}

    seen = {
        name: (1.0 if trajectories.mask is None else float(trajectories.mask[..., data.seen].mean()))
        for name, trajectories in sets.items()
    }
    report = {
        "by": data.settings.split.by,
        "thresholds": thresholds,
        "chunks": {name: len(of) for name, of in rows.items()},
        "trajectories": {
            name: {series[k].name: int(n) for k, n in enumerate(np.bincount(of[:, 0], minlength=len(series))) if n}
            for name, of in rows.items()
        },
        "measured_share": seen,
        "not_measured": [n for n, is_seen in zip(state, data.seen, strict=True) if not is_seen],
        "step_s": data.grid.step_s,
        "steps_off_the_grid": data.grid.broken,
        "interpolation_rms": by_name(data.grid.error),
        "interpolation_note": "of every other row from its neighbours: at the rows' own distances it is far smaller",
        "moved_s": data.grid.moved,
        "noise": by_name(data.noise),
        "rows_of_a_time_twice": sum(trajectory.rows.repeated for trajectory in series),
        "files": {str(path): sha256(path) for path in data.files},
        KEPT: data.settings.to_json(),
    }
    write_json(output_dir / "splits.json", report)
