"""Metrics, forecasts and logs as the stages write them, of made-up methods on two made-up systems."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.summary import TabledMean, read_long, read_metrics
from expertaug.evaluation.tabulate import tabulate
from expertaug.tracking.log import Run
from expertaug.tracking.run_log import RunLog

SETS = ("train", "validation", "test")
LABELS = ("Mean", "Expert only", "ML only", "Hybrid", "Hybrid+")
# Mean log-MSE and relative error in % by label, for each set.
SWING = {
    "Mean": ([0.1, 0.1, 0.4], None),
    "Expert only": ([-1.2, -1.1, 0.6], [15, 16, 70]),
    "ML only": ([-2.4, -2.2, 0.3], None),
    "Hybrid": ([-2.9, -2.7, -0.9], [5, 6, 66]),
    "Hybrid+": ([-3.5, -3.4, -3.3], [5, 6, 10]),
}
PARAMETERS = {"swing": {"omega0": "rad/s"}, "double_swing": {"omega1": "rad/s", "omega2": "rad/s"}}


def method_of(label: str) -> str:
    return label.lower().replace(" ", "_")


def pairs(labels=LABELS) -> dict:
    """What the stages are told of methods and labels."""
    hues = [[method_of(label), k] for k, label in enumerate(labels)]
    return {"labels": [[method_of(label), label] for label in labels], "hues": hues}


def write_metrics(folder: Path, experiment: str = "swing", seeds=(0, 1, 2), labels=LABELS, shift=0.0) -> list[Path]:
    paths = []
    for number, label in enumerate(labels):
        rng = np.random.default_rng(number)
        scores, errors = SWING[label]
        rows = []
        for position, name in enumerate(SETS):
            for seed in seeds:
                score = scores[position] + shift + 0.25 * rng.normal()
                values = {"log_mse_sum": score, "log_mse_dim": score - np.log(2), "log_mse_observed": score - 1}
                if errors:
                    parts = [errors[position] * (1 + 0.15 * rng.normal()) for _ in PARAMETERS[experiment]]
                    values["relative_error"] = np.mean(parts)
                    for parameter, part in zip(PARAMETERS[experiment], parts, strict=True):
                        values |= {f"relative_error_{parameter}": part, f"rmse_{parameter}": part / 100}
                rows += [(seed, name, metric, value) for metric, value in values.items()]
        rows += [(seed, "train", "wall_s", 321.0) for seed in seeds]
        table = pd.DataFrame(rows, columns=["seed", "set", "metric", "value"])
        for key, value in {"preset": "corrected", "label": label, "method": method_of(label)}.items():
            table.insert(0, key, value)
        table.insert(0, "system", "pendulum")
        table.insert(0, "experiment", experiment)
        path = folder / experiment / method_of(label) / ("seeds_" + "_".join(map(str, seeds))) / "metrics.csv"
        path.parent.mkdir(parents=True)
        table.to_csv(path, index=False)
        paths.append(path)
    return paths


def tables_of(metrics: list[Path], **changed) -> list[Path]:
    """The long table of each experiment of these metrics; ``changed`` columns have other values."""
    tables = []
    for folder in dict.fromkeys(path.parents[2] for path in metrics):
        path = folder / "table_long.csv"
        tabulate(read_metrics([one for one in metrics if one.is_relative_to(folder)])).save([path])
        if changed:
            pd.read_csv(path).assign(**changed).to_csv(path, index=False)
        tables.append(path)
    return tables


def rows_of(tables: list[Path]) -> list[TabledMean]:
    """What long tables hold."""
    return [row for path in tables for row in read_long(path)]


def loaded(paths: dict[str, Path]) -> dict[str, Forecasts]:
    """Forecasts of files by method."""
    return {method: Forecasts.load(path) for method, path in paths.items()}


def write_forecasts(folder: Path, labels=LABELS, seeds=(0, 1), count=100) -> dict[str, Path]:
    """A damped oscillator with one parameter: training range [1.5, 3.1], test [0.5, 1.5]."""
    t = np.linspace(0, 20, 201)
    paths = {}
    for label in labels:
        rng = np.random.default_rng(7)
        arrays = {}
        for name, (low, high) in {"validation": (1.5, 3.1), "test": (0.5, 1.5)}.items():
            z = rng.uniform(low, high, (count, 1)).astype(np.float32)
            if name == "validation" or label == "Hybrid+":
                estimate = z + 0.04 * rng.normal(size=(len(seeds), count, 1))
            else:
                estimate = 1.5 + 0.25 * z + 0.08 * rng.normal(size=(len(seeds), count, 1))
            index = np.linspace(0, count - 1, 5)[1:-1].astype(int)
            amplitude = np.exp(-0.05 * t)[None]
            truth = np.stack([amplitude * np.cos(z[index] * t), -z[index] * amplitude * np.sin(z[index] * t)], -1)
            if label == "Mean":
                prediction = np.zeros((len(seeds), *truth.shape))
            elif label == "ML only":
                growth = np.exp(0.12 * np.maximum(t - 6, 0))[:, None]
                prediction = np.repeat((truth * growth)[None], len(seeds), axis=0)
            else:
                w = estimate[:, index]
                prediction = np.stack([amplitude * np.cos(w * t), -w * amplitude * np.sin(w * t)], -1)
            arrays |= {f"{name}_index": index, f"{name}_truth": truth.astype(np.float32)}
            arrays |= {f"{name}_prediction": prediction.astype(np.float32), f"{name}_z_e": z}
            if label not in ("Mean", "ML only"):
                arrays[f"{name}_z_e_hat"] = estimate.astype(np.float32)
        path = paths[method_of(label)] = folder / method_of(label) / "forecasts.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(
            path,
            t=t,
            observed=np.array(50),
            seeds=np.array(seeds),
            state_names=np.array(["theta", "omega"]),
            state_units=np.array(["rad", "rad/s"]),
            parameter_names=np.array(["omega0"]),
            parameter_units=np.array(["rad/s"]),
            **arrays,
        )
    return paths


def write_double_forecasts(folder: Path, labels=("Expert only", "Hybrid", "Hybrid+"), count=600) -> dict[str, Path]:
    """Four state dimensions, two parameters that cross zero, 20 points, three seeds."""
    t = np.arange(20) / 100
    paths = {}
    for label in labels:
        rng = np.random.default_rng(3)
        arrays = {}
        for name, scale in {"validation": 8.0, "test": 18.0}.items():
            z = (scale * rng.normal(size=(count, 2)) * [1, 2]).clip(-60, 60).astype(np.float32)
            squash = 30.0 if label == "Hybrid" else 300.0
            estimate = squash * np.tanh(z / squash) + 0.6 * rng.normal(size=(3, count, 2))
            index = np.linspace(0, count - 1, 5)[1:-1].astype(int)

            def move(w):
                angle = w[..., None, :] * np.sin(9 * t)[:, None] / 9
                return np.concatenate([angle, w[..., None, :] * np.cos(9 * t)[:, None]], -1)

            arrays |= {f"{name}_index": index, f"{name}_truth": move(z[index]), f"{name}_z_e": z}
            arrays |= {f"{name}_prediction": move(estimate[:, index]), f"{name}_z_e_hat": estimate}
        path = paths[method_of(label)] = folder / method_of(label) / "forecasts.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        names = {"state_names": ["theta1", "theta2", "omega1", "omega2"]}
        names |= {"state_units": ["rad", "rad", "rad/s", "rad/s"]}
        names |= {"parameter_names": ["omega1", "omega2"], "parameter_units": ["rad/s", "rad/s"]}
        np.savez(path, t=t, observed=np.array(9), seeds=np.arange(3), **arrays, **names)
    return paths


def write_logs(folder: Path, experiment="swing", labels=("ML only", "Hybrid", "Hybrid+"), steps=800) -> list[Path]:
    paths = []
    for number, label in enumerate(labels):
        rng = np.random.default_rng(number)
        path = folder / experiment / method_of(label) / "seeds_0_1_2" / "log.jsonl"
        stage = "finetune" if label.endswith("+") else "train"
        identity = {"experiment": experiment, "method": method_of(label), "label": label, "system": "pendulum"}
        log = RunLog(path, Run(**identity, preset="corrected", stage=stage, seeds=[0, 1, 2], params={}))
        for step in range(1, steps + 1):
            level = 3.0 * np.exp(-step / 150) + 0.05 / (number + 1)
            values = {"loss": level * np.exp(0.25 * rng.normal(size=3)), "learning_rate": 1e-3}
            if step % 10 == 0:
                values["validation_score"] = np.log(level) - 1 + 0.1 * rng.normal(size=3)
            log.metrics(step, values)
        log.close()
        paths.append(path)
    return paths


def write_samples(
    path: Path, method: str, seeds, errors: dict, experiment="swing", preset="corrected", ids=None, wrong=None
) -> Path:
    """Errors of every sample as the stage evaluate keeps them.

    Arguments:
        errors: squared errors by set, (S, N).
        ids: of the samples, by set; none of simulated ones.
        wrong: relative errors of one parameter, omega0, by set, (S, N): 0.1 is 10 %.
    """
    arrays = {"version": np.array([experiment, preset, method]), "seeds": np.array(seeds)}
    arrays |= {f"{name}_errors": np.asarray(value, dtype=np.float32) for name, value in errors.items()}
    for name, value in (wrong or {}).items():
        arrays |= {f"{name}_z_e": np.ones((value.shape[1], 1)), f"{name}_z_e_hat": 1 + np.asarray(value)[..., None]}
    arrays |= {f"{name}_sample_id": np.array(value) for name, value in (ids or {}).items()}
    arrays |= {"t": np.arange(3.0), "observed": np.array(1), "state_names": np.array(["theta"])}
    arrays |= {"state_units": np.array(["rad"]), "parameter_names": np.array(["omega0"])}
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, parameter_units=np.array(["rad/s"]), **arrays)
    return path


def mean_of(method: str, name: str, score: float) -> TabledMean:
    """The log-MSE of a version on a set."""
    whose = {"experiment": "swing", "system": "pendulum", "preset": "corrected", "method": method, "label": method}
    numbers = {"mean": score, "std": 0.1, "n": 2, "of": 2, "seeds": (0, 1), "low": score - 1, "high": 9.0}
    return TabledMean(**whose, set=name, metric="log_mse_sum", **numbers)
