"""What stated uncertainties of speeds are beside their errors, by frame rate: `python benchmarks/speed_uncertainty.py`.

Double pendulums are let go at random, seen as markers with white noise of .07 px at each rate, and measured as any
recording is.  Printed for each rate: stated over actual root mean square of both speeds, the smallest, middle and
largest of the motions, the smallest and largest of one arm's, and the actual one of both in rad/s; and how many times
as large as the step from 5 frames to 7 the error of slopes through 7 is, by that step's share of the one before
(:mod:`expertaug_recordings.angles.smoothing`).
"""

from __future__ import annotations

import argparse
import logging
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_coeffs

from expertaug.systems.double_pendulum import Constants
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.rendering.motion import simulate
from expertaug_recordings.settings import MeasureAnglesJob

CONSTANTS, FRICTION = Constants(B1=0.103, G1=69.4, B2=1.366, G2=93.6), (0.03, 0.12)
NOISE_PX, ARMS_PX = 0.07, (118.0, 90.0)
SPEEDS = ["omega1", "omega2"]
SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)


def markers(y: np.ndarray, t: np.ndarray, seed: int) -> pd.DataFrame:
    """A markers.csv table of states (n, 4)."""
    places = [np.tile([240.0, 238.0], (len(y), 1))]
    for k, arm in enumerate(ARMS_PX):
        places.append(places[-1] + arm * np.stack([np.sin(y[:, k]), np.cos(y[:, k])], axis=1))
    points = np.concatenate(places, axis=1) + NOISE_PX * np.random.default_rng(seed).normal(size=(len(y), 6))
    table = pd.DataFrame(points, columns=[f"{name}_{axis}" for name in ("pivot", "joint", "tip") for axis in "xy"])
    return table.assign(frame=np.arange(len(y)), t=t, quality=1.0, reason="")


def compared(full: CubicSpline, rate: float, seed: int) -> np.ndarray:
    """Stated and actual mean square error of a recording's two speeds in rad²/s², (2, 2)."""
    t = np.arange(int(full.x[-1] * rate)) / rate
    with tempfile.TemporaryDirectory() as folder:
        seen, table, record = (Path(folder) / name for name in ("markers.csv", "angles.csv", "angles.json"))
        markers(full(t), t, seed).to_csv(seen, index=False)
        measure_angles(seen, table, record, MeasureAnglesJob(rate_hz=float(rate)))
        found = pd.read_csv(table)
    found = found[(found.quality == 1) & found.omega1_std.notna()]
    off = found[SPEEDS].to_numpy() - full(found.t.to_numpy())[:, 2:]
    stated = found[[f"{name}_std" for name in SPEEDS]].to_numpy()
    return np.stack([(stated**2).mean(0), (off**2).mean(0)])


def steps(full: CubicSpline, rate: float) -> pd.DataFrame:
    """Squared errors of slopes through 7 frames without noise, and steps to 5 and to 7 averaged over 9 frames."""
    t = np.arange(int(full.x[-1] * rate)) / rate
    y, found = full(t), []
    for k in (0, 1):
        slopes = []
        for half in (1, 2, 3):
            weights = savgol_coeffs(2 * half + 1, 2 * half, 1, 1 / rate, use="dot")
            slopes.append(np.correlate(y[:, k], weights, "valid")[3 - half : len(t) - 3 - half])
        three, five, seven = slopes
        columns = {"error": seven - y[3:-3, 2 + k], "to_5": five - three, "to_7": seven - five}
        squares = pd.DataFrame(columns).pow(2)
        found.append(squares.rolling(9, center=True).mean().assign(error=squares.error).dropna())
    return pd.concat(found)


def main() -> None:
    """Print a line for each rate, and one for each share."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--motions", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rates", type=float, nargs="+", default=[24, 25, 30, 38, 50, 60, 120])
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    rng, times = np.random.default_rng(options.seed), np.arange(int(400 * options.seconds)) / 400
    lets = [np.concatenate((rng.uniform(-3, 3, 2), rng.normal(0, [4, 8]))) for _ in range(options.motions)]
    motions = [CubicSpline(times, simulate(let[None], times, CONSTANTS, FRICTION)[0]) for let in lets]
    print("rate_hz  stated/actual: least  middle  most  of one arm: least  most   actual rad/s")
    for rate in options.rates:
        stated, actual = np.array([compared(full, rate, seed) for seed, full in enumerate(motions)]).swapaxes(0, 1)
        least, middle, most = np.quantile(np.sqrt(stated.sum(1) / actual.sum(1)), [0, 0.5, 1])
        each = np.sqrt(stated / actual)
        print(
            f"{rate:7g} {least:21.2f} {middle:7.2f} {most:5.2f} {each.min():18.2f} {each.max():5.2f}"
            f" {np.sqrt(actual.mean()):14.3f}",
            flush=True,
        )
    slopes = pd.concat([steps(full, rate) for full in motions for rate in options.rates if rate <= 60])
    share = pd.cut(np.sqrt(slopes.to_7 / slopes.to_5), SHARES)
    each = slopes.groupby(share, observed=True)[["error", "to_7"]].sum()
    for interval, row in each.iterrows():
        print(f"share in {interval}: {np.sqrt(row.error / row.to_7):.2f} times the step to 7")


if __name__ == "__main__":
    main()
