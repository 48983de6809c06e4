"""The compound expert's constants from the training chunks, judged by their forecasts."""

from __future__ import annotations

import math
from pathlib import Path

import torch

from expertaug.errors import InputError
from expertaug.files import write_json
from expertaug.systems.double_pendulum import Constants
from expertaug.trajectories import Trajectories
from expertaug_recordings.angles.forecast import forecast
from expertaug_recordings.angles.pendulum_fit import Fit, fit_constants, implied_rate
from expertaug_recordings.settings import CalibrateJob


def forecast_log_mse(
    chunks: Trajectories,
    constants: Constants | None,
    friction: tuple[float, float] = (0.0, 0.0),
    step: float = 0.005,
) -> float:
    """Log-MSE of forecasts from each chunk's own first state.

    Natural log of the mean, over chunks, measured points (the first included) and both angles, of (Δ sin)² + (Δ cos)².
    """
    truth = torch.as_tensor(chunks.seen, dtype=torch.float64)
    truth = truth[truth[:, 0].isfinite().all(-1)]  # where a forecast can start
    predicted = forecast(truth[:, 0], len(chunks.t), float(chunks.t[1] - chunks.t[0]), constants, friction, step)
    difference = predicted[..., :2] - truth[..., :2]
    return math.log(float((2 - 2 * torch.cos(difference)).nanmean()))  # (Δ sin)² + (Δ cos)² = 2 − 2 cos Δ


def run_stage(train: str | Path, output: str | Path, job: CalibrateJob) -> None:
    """Stage: fit the compound expert's constants on the training chunks alone and write ``calibration.json``.

    Arguments:
        train: npz of :class:`expertaug.trajectories.Trajectories`, states (θ1, θ2, θ1', θ2').
        output: JSON of what :func:`calibrate` says.
        job: what is known of the recordings.

    Raises:
        InputError: a file without chunks of enough points, or motion that determines no pendulum.
    """
    write_json(output, calibrate(Trajectories.load(train), job, train))


def calibrate(chunks: Trajectories, job: CalibrateJob, where: object = "chunks") -> dict[str, object]:
    """Fit the compound expert's constants.

    Arguments:
        chunks: states (θ1, θ2, θ1', θ2').
        job: what is known of the recordings.
        where: what messages call the chunks.

    Returns:
        the constants, their standard errors (clustered by chunk; chunks that overlap count as independent), R², the
        log-MSE of forecasts of the chunks, the same with joint friction, the frame rate that the motion implies (by the
        fit with friction) and the settings used.

    Raises:
        InputError: too few chunks or points, or motion that determines no pendulum.
    """
    if len(chunks) < 10 or chunks.y.ndim != 3 or chunks.y.shape[1] < 7 or chunks.y.shape[2] != 4:
        problem = f"{len(chunks)} chunks, y of shape {chunks.y.shape}"
        raise InputError(where, problem, "at least 10 chunks of 7 points or more are needed, (N, T, 4)")
    interval = float(chunks.t[1] - chunks.t[0])
    try:
        plain, rubbed = (fit_constants(chunks.seen, interval, friction) for friction in (False, True))
    except InputError as error:
        raise InputError(where, str(error)) from error
    report = _describe(chunks, plain, job)
    report["with_friction"] = {"friction": list(rubbed.friction)} | _describe(chunks, rubbed, job)
    rate, arm = job.nominal_rate_hz, job.arm1_m
    return report | {
        "implied_rate_hz": None if rate is None or arm is None else implied_rate(rubbed.constants, rate, arm),
        "chunks": len(chunks),
        **{name: value for name, value in job.model_dump().items() if name != "step_s"},
    }


def _describe(chunks: Trajectories, fit: Fit, job: CalibrateJob) -> dict[str, object]:
    return {
        "constants": fit.constants.to_dict(),
        "std_errors": fit.std_errors,
        "r2_1": fit.r2[0],
        "r2_2": fit.r2[1],
        "train_log_mse": forecast_log_mse(chunks, fit.constants, fit.friction, job.step_s),
    }
