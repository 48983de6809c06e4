"""The stage cut_measurements: chunks of measurements as files of sets, and what is known of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from expertaug.files import atomic, sha256, write_json
from expertaug.measurements.cut import Divided, Measured, measure, sets_of
from expertaug.measurements.names import Names
from expertaug.measurements.settings import MeasurementSettings
from expertaug.measurements.windows import KEPT


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
    data = measure(settings.of_files(files), names)
    data.warn_of_slopes()
    divided = sets_of(data)
    data.warn_of_short()
    for name, trajectories in divided.sets.items():
        trajectories.save(output_dir / f"{name}.npz")
    with atomic(output_dir / "chunks.csv") as temporary:
        chunks_table(data, divided).to_csv(temporary, index=False, float_format="%.9g")
    digests = {str(path): sha256(path) for path in data.files}
    report = describe_sets(data, divided) | {"files": digests, KEPT: data.settings.to_json()}
    write_json(output_dir / "splits.json", report)


def chunks_table(data: Measured, divided: Divided) -> pd.DataFrame:
    """A row for each chunk of each set: of which trajectory it is, and when it begins."""
    series, tables = data.grid.series, []
    for name, rows in divided.rows.items():
        identity = divided.sets[name].id
        assert identity is not None
        first = [float(series[index].t[point]) for index, point in rows]
        named = {"trajectory": [series[index].name for index, _ in rows], "first_s": first}
        tables.append(pd.DataFrame({"chunk": np.arange(len(rows)), **named, "id": identity, "split": name}))
    return pd.concat(tables)


def describe_sets(data: Measured, divided: Divided) -> dict[str, object]:
    """What splits.json says of measurements and their sets, but of files."""
    series, state = data.grid.series, list(data.names.state)

    def by_name(values: np.ndarray | None) -> dict[str, float | None] | None:
        if values is None:
            return None
        return {n: float(v) if np.isfinite(v) else None for n, v in zip(state, values, strict=True)}

    seen = {
        name: (1.0 if trajectories.mask is None else float(trajectories.mask[..., data.seen].mean()))
        for name, trajectories in divided.sets.items()
    }
    return {
        "by": data.settings.split.by,
        "thresholds": divided.thresholds,
        "chunks": {name: len(rows) for name, rows in divided.rows.items()},
        "trajectories": {
            name: {series[k].name: int(n) for k, n in enumerate(np.bincount(rows[:, 0], minlength=len(series))) if n}
            for name, rows in divided.rows.items()
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
    }
