"""PySINDy on the data of an experiment: `python benchmarks/pysindy_rows.py results/measurements/real_pendulum`.

PySINDy is no dependency of the package: `pip install pysindy` beside it.  It learns one equation from the training
windows, at its defaults (polynomials of second degree, threshold 0.1, finite differences), or with the library,
threshold and derivative that validation chooses.  Forecasts begin at the last observed point, or where least squares
of the equation on the observed window say.  Scores are those of the run's tables: log-MSE after the observed window,
with 95 % intervals over windows.
"""

from __future__ import annotations

import argparse
import os
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np

from expertaug.trajectories import Trajectories

try:
    import pysindy
    from pysindy.differentiation import FiniteDifference, SmoothedFiniteDifference
    from pysindy.feature_library import FourierLibrary, PolynomialLibrary
except ImportError:
    raise SystemExit("pysindy_rows.py needs PySINDy: pip install pysindy") from None

SETS = ("train", "validation", "test")
THRESHOLDS = (0.003, 0.01, 0.03, 0.1, 0.3)
SUBSTEPS, STEPS, FARTHEST = 4, 12, 10.0  # of Runge and Kutta, of the fit of a start, and times the largest value
DRAWS = 2000
Law = Callable[[np.ndarray], np.ndarray]  # states (N, K) → rates


@dataclass(frozen=True, eq=False)
class Equation:
    """What PySINDy has found, and from what."""

    library: str
    threshold: float
    derivative: str
    model: pysindy.SINDy
    largest: np.ndarray
    law: Law

    def forecast(self, y0: np.ndarray, t: np.ndarray) -> np.ndarray:
        """States (T, N, K) from (N, K); what runs away stays at a bound."""
        bound, y, states = FARTHEST * self.largest, y0, [y0]
        for step in np.diff(t):
            h = step / SUBSTEPS
            for _ in range(SUBSTEPS):
                k1 = self.rates(y)
                k2 = self.rates(y + h / 2 * k1)
                k3 = self.rates(y + h / 2 * k2)
                y = np.clip(np.nan_to_num(y + h / 6 * (k1 + 2 * k2 + 2 * k3 + self.rates(y + h * k3))), -bound, bound)
            states.append(y)
        return np.stack(states)

    def rates(self, y: np.ndarray) -> np.ndarray:
        """dy/dt (N, K) of states."""
        return self.law(np.clip(y, -FARTHEST * self.largest, FARTHEST * self.largest))

    def started(self, seen: np.ndarray, t: np.ndarray) -> np.ndarray:
        """First points (N, K) that fit observed windows (T1, N, K) best, by Levenberg and Marquardt's method."""
        y0, scale = seen[0].copy(), np.nanstd(seen, axis=(0, 1))
        y0 = np.where(np.isnan(y0), np.nanmean(seen, axis=0), y0)
        damping = np.full(len(y0), 1e-2)

        def residuals(first: np.ndarray) -> np.ndarray:
            away = np.nan_to_num((self.forecast(first, t) - seen) / scale)
            return away.transpose(1, 0, 2).reshape(len(first), -1)

        here = residuals(y0)
        for _ in range(STEPS):
            moved = [residuals(y0 + 1e-5 * scale * axis) for axis in np.eye(len(scale))]
            jacobian = np.stack([(m - here) / 1e-5 for m in moved], axis=-1)
            curvature = jacobian.transpose(0, 2, 1) @ jacobian
            damped = curvature * (1 + damping[:, None, None] * np.eye(len(scale))) + 1e-12 * np.eye(len(scale))
            slope = np.einsum("nmk,nm->nk", jacobian, here)
            trial = y0 - scale * np.clip(np.linalg.solve(damped, slope[..., None])[..., 0], -0.5, 0.5)
            new = residuals(trial)
            better = (new**2).sum(1) < (here**2).sum(1)
            y0, here = np.where(better[:, None], trial, y0), np.where(better[:, None], new, here)
            damping = np.where(better, damping / 5, damping * 4)
        return y0


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("experiment", type=Path, help="its folder in the results of a run")
    parser.add_argument("--t1", type=float, default=4.0, help="end of the observed window in s")
    parser.add_argument("--angles", nargs="*", type=int, default=[0], help="places of components that are angles")
    parser.add_argument("--turns", action="store_true", help="score the angles alone, modulo whole turns, as the mean")
    options = parser.parse_args()
    turning = options.angles if options.turns else None
    sets = {name: Trajectories.load(options.experiment / "data" / f"{name}.npz") for name in SETS}
    warnings.simplefilter("ignore")
    began = time.process_time()
    (plain,) = candidates(sets["train"], options.angles, defaults=True)
    tried = list(candidates(sets["train"], options.angles))
    chosen = {
        start: min(tried, key=lambda one: log_mse(errors(one, sets["validation"], options.t1, start, turning)))
        for start in ("last point", "fitted")
    }
    seconds = time.process_time() - began
    print(f"| PySINDy {pysindy.__version__} | start | {' | '.join(SETS)} |\n| --- | --- | ---: | ---: | ---: |")
    for start, best in chosen.items():
        for label, one in (("defaults", plain), (f"{best.library}, {best.threshold:g}, {best.derivative}", best)):
            cells = [interval(errors(one, data, options.t1, start, turning)) for data in sets.values()]
            print(f"| {label} | {start} | {' | '.join(cells)} |")
    for equation in (plain, *dict.fromkeys(chosen.values())):
        print(*equation.model.equations(precision=4), sep="; ")
    print(f"{len(tried)} equations in {seconds:.0f} CPU seconds, with validation")


def candidates(train: Trajectories, angles: list[int], defaults: bool = False) -> Iterator[Equation]:
    """Equations of all ways, or at PySINDy's defaults."""
    whole = ~np.isnan(train.seen).any((1, 2))
    states, count = [np.asarray(y, dtype=float) for y in train.seen[whole]], train.y.shape[-1]
    largest = np.abs(train.y).max((0, 1)).astype(float)

    def library(name: str) -> pysindy.feature_library.base.BaseFeatureLibrary:
        powers = PolynomialLibrary(degree=int(name.split()[1]))
        if "sines" not in name:
            return powers
        rest = [k for k in range(count) if k not in angles or "for angles" not in name]
        return pysindy.GeneralizedLibrary([powers, FourierLibrary(n_frequencies=1)], inputs_per_library=[rest, angles])

    ways = [("degree 2", 0.1, "differences")]
    if not defaults:
        more = ("", " and sines", " with sines for angles")
        names = [f"degree {degree}{of_angles}" for degree in (1, 2, 3) for of_angles in more]
        ways = [(n, threshold, d) for n in names for threshold in THRESHOLDS for d in ("differences", "smoothed")]
    for name, threshold, derivative in ways:
        model = pysindy.SINDy(
            optimizer=pysindy.STLSQ(threshold=threshold),
            feature_library=library(name),
            differentiation_method=FiniteDifference() if derivative == "differences" else SmoothedFiniteDifference(),
        )
        try:
            model.fit(states, t=[np.asarray(train.t, dtype=float)] * len(states))
        except ValueError:  # every term is below the threshold
            continue
        yield Equation(name, threshold, derivative, model, largest, law_of(model))


def law_of(model: pysindy.SINDy) -> Law:
    """The equation as a function: PySINDy's own prediction makes and checks its whole library each time."""
    names, coefficients = model.get_feature_names(), np.asarray(model.coefficients())
    rates = []
    for row in coefficients:
        terms = [f"{c!r}*{names[k].replace('^', '**').replace(' ', '*')}" for k, c in enumerate(row.tolist()) if c]
        rates.append("+".join(terms) or "0.0")
    states = ", ".join(f"x{k}" for k in range(len(coefficients)))
    code = f"lambda {states}: ({', '.join(rates)},)"
    compiled = eval(code, {"sin": np.sin, "cos": np.cos})  # of PySINDy's own names

    def law(y: np.ndarray) -> np.ndarray:
        return np.stack([np.broadcast_to(rate, y.shape[:-1]) for rate in compiled(*y.T)], axis=-1)

    return law


def errors(
    equation: Equation, data: Trajectories, t1: float, start: str, turning: list[int] | None = None
) -> np.ndarray:
    """Squared errors (N,) of forecasts after the observed window, means over what was seen.

    Arguments:
        turning: places of angles that count, modulo whole turns, over which it is the mean; None: the sum of all.
    """
    y, t = data.seen.astype(float).transpose(1, 0, 2), data.t.astype(float)
    observed = int((t <= t1 + 1e-9).sum())
    if start == "fitted":
        forecast = equation.forecast(equation.started(y[:observed], t[:observed]), t)[observed:]
    else:
        forecast = np.empty_like(y[observed:])
        measured = ~np.isnan(y[:observed]).any(2)
        last = observed - 1 - measured[::-1].argmax(0)  # the last point of each window that was measured
        for place in np.unique(last):
            some = last == place
            forecast[:, some] = equation.forecast(y[place, some], t[place:])[observed - place :]
    away = forecast - y[observed:]
    squares = (away**2).sum(-1) if turning is None else (2 - 2 * np.cos(away[..., turning])).mean(-1)
    return np.nanmean(squares, axis=0)


def log_mse(each: np.ndarray) -> float:
    return float(np.log(each.mean()))


def interval(each: np.ndarray) -> str:
    """log-MSE [95 % interval over windows]."""
    rng = np.random.default_rng(0)
    drawn = np.log(each[rng.integers(0, len(each), (DRAWS, len(each)))].mean(1))
    low, high = np.quantile(drawn, (0.025, 0.975))
    return f"{log_mse(each):.2f} [{low:.2f}, {high:.2f}]".replace("-", "−")


if __name__ == "__main__":
    main()
