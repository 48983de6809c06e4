"""Series of pictures of another laboratory's kind, from inspect to tables by the proposed configuration alone.

    python benchmarks/other_labs.py [OUTPUT] [--frames 600]

Pictures (JPEG) of 1000×1000 px at 38 Hz with a third of the intervals more than 10 % off: disks of 60 px with a ring, a
line and a dot burnt in, the joint's 3.6 px off its hinge, on a wall as bright as they are.  OUTPUT (default
results/other_labs) gets series.csv: of the frames whose markers are all within 1 px the share that is used, the largest
error of a used marker, the share of angles that are used with their errors in degrees (without the proposed direction
of gravity's, which is told apart), and stated over actual errors.
Exit status 1 where less than 95 % of a series' right frames are used, a used marker is off by more than 1 px, or an
angle by more than .1° in the median.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import cv2
import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests" / "recordings"))  # the series are those of its tests

from laboratory import Series, scores, to_tables  # noqa: E402

from expertaug.errors import InputError  # noqa: E402
from expertaug.files import atomic  # noqa: E402

WHOLE = Series()
KINDS = {
    "times in a table": WHOLE,
    "times in names": replace(WHOLE, times="names", marks=("screw", "text", "ring")),
    "light from one side": replace(WHOLE, light=0.4),
    "half as large": replace(WHOLE, side=500, diameter=28.0),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path, nargs="?", default=Path("results/other_labs"))
    parser.add_argument("--frames", type=int, default=WHOLE.frames)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    logging.getLogger("expertaug_recordings").setLevel(logging.ERROR)
    rows = []
    for name, kind in KINDS.items():
        series = replace(kind, frames=options.frames)
        with tempfile.TemporaryDirectory() as work:
            folder = Path(work) / "series"
            try:
                markers, angles, _ = to_tables(folder, series.write(folder), Path(work))
                row = scores(series, markers, angles) | {"refused": ""}
            except InputError as error:
                row = {"refused": str(error).replace(f"{work}/", "")}
        rows.append({"series": name} | row)
        print(pd.DataFrame(rows[-1:]).to_string(index=False, header=len(rows) == 1, float_format="%.3g"), flush=True)
    table = pd.DataFrame(rows)
    options.output.mkdir(parents=True, exist_ok=True)
    with atomic(options.output / "series.csv") as path:
        table.to_csv(path, index=False, float_format="%.4g")
    taken = (table["refused"] == "") & (table["used_of_right"] >= 0.95)
    return int(not (taken & (table["largest_px"] <= 1) & (table["deg"] <= 0.1)).all())


if __name__ == "__main__":
    sys.exit(main())
