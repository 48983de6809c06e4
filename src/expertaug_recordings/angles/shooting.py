"""What no pendulum's motion explains of measured angles, by short trajectories fitted to them.

The fit of the constants (:mod:`.pendulum_fit`) needs speeds, which at low frame rates err by more than the angles do.
Here each window of a few frames gets a state of its own to start from, all windows share the constants, the friction
and the direction of gravity, and the angles alone are compared: by Gauss-Newton with damping, the windows' own unknowns
eliminated.  What is left beyond the markers' noise is error that their lengths do not show: frames at other times than
theirs, a shutter that rolls, another thing than a pendulum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.optimize import nnls

from expertaug.systems.double_pendulum import Constants
from expertaug_recordings.angles.forecast import forecast
from expertaug_recordings.angles.noise import Noise
from expertaug_recordings.angles.pendulum_fit import Fit

SPAN_S = 0.01  # between the points of a window where frames are nearer to each other
POINTS = 6  # of a window
MOST = 120  # windows, which tell enough
FEWEST = 6  # windows, below which nothing is said
ALONE, TOGETHER = 6, 10  # passes at most
SETTLED = 1e-4  # of the misfit, below which a pass gains nothing
BINS = 8  # of speed
STEP = 1e-6  # by which an unknown is changed to see what it does
MORE = 1.4  # times the noise, above which there is another error besides
LESS, ALIKE = 1.3, 0.3  # times the misfit, above which the noise is stated too large; correlation of frames' errors
LOST = 25.0  # times the median misfit of the windows: no trajectory was found for one further off


@dataclass(frozen=True)
class Misfit:
    """How far measured angles are off the motion of a pendulum.

    Attributes:
        rms: of both angles in rad, (2,), what was known included.
        known: the same of the errors that were known, (2,).
        steady: variance in rad² beyond that noise that does not depend on the speed, (2,).
        timing: variance in s² of the times by which the rest is told: it grows with the square of the speed, (2,).
        every: frames from one point of a window to the next.
    """

    rms: np.ndarray
    known: np.ndarray
    steady: np.ndarray
    timing: np.ndarray
    every: int

    @property
    def beyond(self) -> bool:
        """Whether it is more than was known."""
        return bool((self.rms > MORE * self.known).any())

    def share(self, noise: Noise) -> np.ndarray:
        """By which the noise of the angles is less than the arms' lengths have it, (2,); 1 where that is not certain.

        Errors that neighbouring frames have in common are no misfit, so that nothing is said where the lengths' are.
        """
        alike = noise.correlation[self.every] if len(noise.correlation) > self.every else np.zeros(2)
        less = (LESS * self.rms < self.known) & (alike < ALIKE)
        return np.where(less, self.rms / np.where(less, self.known, 1.0), 1.0)

    def error(self, speeds: np.ndarray) -> np.ndarray:
        """Standard deviations in rad of the angles' errors besides their noise at speeds in rad/s, (n, 2) both."""
        return np.sqrt(self.steady + self.timing * speeds**2)


def misfit(
    angles: np.ndarray, states: np.ndarray, std: np.ndarray, fit: Fit, rate: float, single: bool = False
) -> Misfit | None:
    """Fit trajectories to windows of a recording, and say what they leave.

    Arguments:
        angles: measured ones in rad, (n, 2), unwrapped within a stretch; NaN where a frame is not to be used.
        states: of the smoothed motion, (n, 4), where to begin.
        std: standard deviations of the errors of the measured angles that are known, in rad, (n, 2).
        fit: constants to begin with.
        rate: frames per second.
        single: the second angle says nothing.

    Returns:
        None where too few windows have a trajectory.
    """
    every = max(1, round(SPAN_S * rate))
    rows = _windows(np.isfinite(angles).all(1) & np.isfinite(states).all(1), every)
    if len(rows) < FEWEST:
        return None
    arms = [0] if single else [0, 1]
    even = np.sqrt(np.mean(std[rows] ** 2, axis=(0, 1)))
    problem = _Problem(angles[rows][..., arms], even[arms], every / rate, every, single)
    start = states[rows[:, 0]][:, [0, 2]] if single else states[rows[:, 0]]
    return _solve(problem, start, fit, states[rows][..., [2, 2] if single else [2, 3]])


def _windows(usable: np.ndarray, every: int) -> np.ndarray:
    """Rows (m, POINTS) of windows that lie apart, spread over the recording."""
    span = (POINTS - 1) * every + 1
    count = np.concatenate(([0], np.cumsum(usable)))
    whole = np.flatnonzero(count[span:] - count[:-span] == span) if len(usable) >= span else np.zeros(0, int)
    first, end = [], -1
    for row in whole:
        if row > end:
            first.append(row)
            end = row + span - 1
    chosen = np.array(first, dtype=int)
    if len(chosen) > MOST:
        chosen = chosen[np.linspace(0, len(chosen) - 1, MOST).round().astype(int)]
    return chosen[:, None] + every * np.arange(POINTS)


@dataclass(frozen=True)
class _Problem:
    """Windows of measured angles, in standard deviations of their noise."""

    angles: np.ndarray  # (m, POINTS, arms)
    noise: np.ndarray  # (arms,)
    interval: float
    every: int
    single: bool

    def predict(self, states: np.ndarray, shared: np.ndarray) -> np.ndarray:
        """Angles (k, POINTS, arms) of starts (k, 4 or 2) and shared unknowns (k, 7 or 3), tilt last."""
        start = torch.as_tensor(states)
        unknowns = torch.as_tensor(shared)
        if self.single:
            zero, unit = torch.zeros(len(start), dtype=start.dtype), torch.ones(len(start), dtype=start.dtype)
            start = torch.stack((start[:, 0], zero, start[:, 1], zero), dim=1)
            constants, friction = Constants(zero, unknowns[:, 0], unit, unit), (unknowns[:, 1], zero)  # type: ignore[arg-type]
        else:
            constants = Constants(*(unknowns[:, k] for k in range(4)))  # type: ignore[arg-type]
            friction = (unknowns[:, 4], unknowns[:, 5])
        tilt = shared[:, -1]
        start = start.clone()
        start[:, :2] -= torch.as_tensor(tilt)[:, None]
        made = forecast(start, POINTS, self.interval, constants, friction)  # type: ignore[arg-type]
        return made[..., : self.angles.shape[2]].numpy() + tilt[:, None, None]

    def possible(self, shared: np.ndarray) -> bool:
        """Whether these are a pendulum's constants."""
        if self.single:
            return bool(shared[0] > 0)
        return bool((shared[:4] > 0).all() and shared[0] * shared[2] < 1)

    def off(self, states: np.ndarray, shared: np.ndarray) -> np.ndarray:
        """Misfits in standard deviations (m, POINTS arms)."""
        made = self.predict(states, np.broadcast_to(shared, (len(states), len(shared))).copy())
        return ((self.angles - made) / self.noise).reshape(len(states), -1)

    def slopes(self, states: np.ndarray, shared: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Misfits, and what each unknown does to the angles: (m, q), (m, q, own) and (m, q, shared)."""
        m, own, common = len(states), states.shape[1], len(shared)
        steps = np.concatenate((np.full(own, STEP), STEP * np.maximum(np.abs(shared), 1e-2)))
        all_states = np.tile(states, (1 + own + common, 1, 1))
        all_shared = np.tile(shared, (1 + own + common, m, 1))
        for k in range(own):
            all_states[1 + k, :, k] += steps[k]
        for k in range(common):
            all_shared[1 + own + k, :, k] += steps[own + k]
        made = self.predict(all_states.reshape(-1, own), all_shared.reshape(-1, common))
        made = (made / self.noise).reshape(1 + own + common, m, -1)
        slope = ((made[1:] - made[0]) / steps[:, None, None]).transpose(1, 2, 0)
        return (self.angles / self.noise).reshape(m, -1) - made[0], slope[..., :own], slope[..., own:]


def _solve(problem: _Problem, states: np.ndarray, fit: Fit, speeds: np.ndarray) -> Misfit | None:
    """Damped Gauss-Newton: each window for itself first, then all with what they share."""
    c = fit.constants
    shared = np.array([c.G1, fit.friction[0], 0.0] if problem.single else [c.B1, c.G1, c.B2, c.G2, *fit.friction, 0.0])
    damping = np.full(len(states), 1e-3)
    for turn in range(ALONE + TOGETHER):
        off, a, b = problem.slopes(states, shared)
        cost = _sums(off)
        used = np.isfinite(cost) & np.isfinite(a).all((1, 2)) & np.isfinite(b).all((1, 2))
        if used.sum() < FEWEST:
            return None
        used &= cost <= LOST * max(float(np.median(cost[used])), off.shape[1])
        off, a, b = (np.where(used.reshape(-1, *[1] * (v.ndim - 1)), v, 0.0) for v in (off, a, b))
        step, move = _step(off, a, b, damping)
        if turn < ALONE:
            move = np.zeros_like(move)
            step, _ = _step(off, a, b[..., :0], damping)
        tried, changed = states + step, shared + move
        after = _sums(problem.off(tried, changed)) if problem.possible(changed) else np.full(len(states), np.inf)
        if turn < ALONE:
            fine = after < cost
            states = np.where(fine[:, None], tried, states)
            damping = np.clip(np.where(fine, damping / 5, damping * 8), 1e-9, 1e6)
            continue
        gained = cost[used].sum() - after[used].sum()
        if gained > 0:
            states, shared = tried, changed
        damping = np.clip(damping * (0.2 if gained > 0 else 8.0), 1e-9, 1e6)
        if 0 <= gained < SETTLED * cost[used].sum():
            break
    problem = replace(problem, angles=problem.angles[used])
    return _judge(problem.off(states[used], shared), len(shared), problem, speeds[used])


def _sums(off: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):
        return np.nan_to_num((off**2).sum(1), nan=np.inf)


def _step(off: np.ndarray, a: np.ndarray, b: np.ndarray, damping: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Changes of the windows' own unknowns (m, own) and of the shared ones."""
    inner = np.einsum("mqi,mqj->mij", a, a)
    inner += np.einsum("m,mi,ij->mij", damping, np.einsum("mii->mi", inner) + 1e-9, np.eye(a.shape[2]))
    cross, side = np.einsum("mqi,mqj->mij", a, b), np.einsum("mqi,mq->mi", a, off)
    solved = np.linalg.solve(inner, np.concatenate((cross, side[..., None]), -1))
    normal = np.einsum("mqi,mqj->ij", b, b) - np.einsum("mij,mik->jk", cross, solved[..., :-1])
    target = np.einsum("mqi,mq->i", b, off) - np.einsum("mij,mi->j", cross, solved[..., -1])
    scale = np.sqrt(np.maximum(np.diag(normal), 0)) + 1e-12
    lifted = normal / np.outer(scale, scale) + (1e-9 + float(np.median(damping))) * np.eye(len(scale))
    move = np.linalg.solve(lifted, target / scale) / scale
    return solved[..., -1] - np.einsum("mij,j->mi", solved[..., :-1], move), move


def _judge(off: np.ndarray, common: int, problem: _Problem, speeds: np.ndarray) -> Misfit:
    arms = problem.angles.shape[2]
    own = 2 if problem.single else 4
    free = off.size - own * len(off) - common
    noise = problem.noise
    square = (off.reshape(problem.angles.shape) * noise) ** 2 * (off.size / free)
    parts = np.zeros((2, 2))
    for k in range(arms):
        parts[:, k] = _parts(square[..., k].ravel() - noise[k] ** 2, speeds[..., k].ravel() ** 2)
    rms, noise_rms = np.zeros((2, 2))
    rms[:arms], noise_rms[:arms] = np.sqrt(square.mean((0, 1))), noise
    return Misfit(rms, noise_rms, parts[0], parts[1], problem.every)


def _parts(excess: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Of squared misfits beyond the noise (n,) what is steady and what grows with the squared speed (n,)."""
    order = np.array_split(np.argsort(square), BINS)
    high, fast = (np.array([values[part].mean() for part in order]) for values in (excess, square))
    weight = 1 / np.maximum(np.abs(high), np.abs(high).mean())
    coefficients, _ = nnls(np.stack((weight, weight * fast), 1), weight * high)
    fitted = coefficients[0] + coefficients[1] * fast.mean()
    return coefficients * (max(float(excess.mean()), 0.0) / fitted if fitted > 0 else 0.0)
