"""What measure_angles would say of a recording that nobody measured."""

import numpy as np
import pandas as pd
from pendulum_motion import CONSTANTS

from expertaug.systems.double_pendulum import energy
from expertaug_recordings.angles.summary import RecordingSummary


def summary(name, frames, rate_hz, arms, pivot, **change):
    """The summary of a recording of which every frame is measured."""
    numbers = dict.fromkeys(("arm1_std_px", "arm2_std_px", "noise1_deg", "noise2_deg"), 0.1)
    uncertain = ("uncertainty1_deg", "uncertainty2_deg", "uncertainty1_rad_s", "uncertainty2_rad_s")
    numbers |= dict.fromkeys(uncertain, 0.1)
    counts = dict.fromkeys(("gaps", "longest_gap_frames", "interpolated", "rejected_arm_length", "rejected_outlier"), 0)
    values = {
        "recording": name,
        "frames": frames,
        "duration_s": frames / rate_hz,
        "tracked_share": 1.0,
        "usable_share": 1.0,
        "arm1_px": arms[0],
        "arm2_px": arms[1],
        "pivot_x_px": pivot[0],
        "pivot_y_px": pivot[1],
        "offsets_px": {},
        "pivot_window_s": None,
        "unsmoothed_share": (0.0, 0.0),
        "reasons": {},
        "rate_hz": rate_hz,
        "rate_provenance": "a label",
        "implied_rate_hz": rate_hz,
        "rotation_deg": 0.0,
        "implied_rotation_deg": 0.0,
        "warnings": [],
        "constants": {"B1": 0.1, "G1": 69.0, "B2": 1.3, "G2": 93.0},
        "friction": (0.0, 0.0),
        "r2_1": 1.0,
        "r2_2": 1.0,
        "energy_start": 300.0,
        "energy_end": 200.0,
    }
    return RecordingSummary(**{**numbers, **counts, **values, **change})


def write_angles(folder, y, rate=400.0, gaps=(), half=()):
    """angles.csv of true states; ``gaps`` and ``half`` are (start, stop) of unusable and of interpolated frames."""
    quality = np.ones(len(y))
    y = y.copy()
    for start, stop in gaps:
        quality[start:stop], y[start:stop] = 0, np.nan
    for start, stop in half:
        quality[start:stop] = 0.5
    table = pd.DataFrame({"frame": np.arange(len(y)), "t": np.arange(len(y)) / rate})
    for k, name in enumerate(("theta1", "theta2", "omega1", "omega2")):
        table[name] = y[:, k]
    table["energy"], table["quality"], table["reason"] = energy(y, CONSTANTS), quality, ""
    folder.mkdir(parents=True, exist_ok=True)
    table.to_csv(folder / "angles.csv", index=False)
    return folder / "angles.csv"
