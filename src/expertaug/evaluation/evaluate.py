"""The stage evaluate: metrics and forecasts of one trained block of seeds on every set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from torch import Tensor

from expertaug.errors import InputError, SolveError
from expertaug.evaluation import figures, traces
from expertaug.evaluation.metrics import log_mse, parameter_errors
from expertaug.files import atomic
from expertaug.models import store
from expertaug.models.device import device_of
from expertaug.runlog import RunLog
from expertaug.systems.solver import Solver, check_finite
from expertaug.types import Trajectories

SETS = ("train", "validation", "test")
CHUNK = 2048  # samples forecast at a time: bounds the memory


def evaluate(
    model: Path, data: Path, metrics: Path, forecasts: Path, settings: Mapping, tracking: Mapping | None
) -> None:
    """Write the metrics of every seed and set, and forecasts of chosen samples.

    Arguments:
        model: file of the trained model.
        data: folder of the sets.
        metrics: CSV in long format (experiment, system, method, label, preset, seed, set, metric, value).
        forecasts: npz; its arrays are named in :func:`_collect`.  Beside it forecasts.png and parameters.png are drawn,
            this block's own figures.
        settings: {experiment, method, label, preset, evaluation, choices, seeds, device}; ``evaluation``
            has ``samples`` (forecasts kept of each set), ``from_s`` (the metric sees times from there on; null = those
            after the observed window), ``max_samples`` (of each set, evenly spread; null = all) and ``solver``.

    Raises:
        InputError: the model and the settings disagree on the seeds.
    """
    device = device_of(settings["device"])
    stored = store.load(model, device)
    if stored.seeds != list(settings["seeds"]):
        raise InputError(model, f"holds seeds {stored.seeds}", f"expected {list(settings['seeds'])}: train again")
    options = settings["evaluation"]
    solver = Solver.from_mapping(options.get("solver") or {"method": "dopri5", "rtol": 1e-6, "atol": 1e-6})
    identity = {k: settings[k] for k in ("experiment", "method", "label", "preset")}
    identity["system"] = stored.description["system"]["name"]
    rows, arrays = [], {}
    for name in SETS:
        truth = _spread(Trajectories.load(Path(data) / f"{name}.npz"), options.get("max_samples"))
        prediction, z_e = _forecast(stored, truth, solver, settings["choices"]["forecast_start"], device)
        values = _score(stored, truth, prediction, z_e, options.get("from_s"))
        rows += [
            {**identity, "seed": seed, "set": name, "metric": metric, "value": float(value[k])}
            for metric, value in values.items()
            for k, seed in enumerate(stored.seeds)
        ]
        if name == "train":
            arrays["train_z_e"] = truth.z_e
        else:
            arrays |= _collect(name, truth, prediction, z_e, int(options.get("samples", 3)))
    rows += [
        {**identity, "seed": seed, "set": "train", "metric": "wall_s", "value": stored.description["wall_s"]}
        for seed in stored.seeds
    ]
    system = stored.model.system
    arrays |= {
        "t": truth.t,
        "observed": np.array(stored.description["observed"] - 1),
        "seeds": np.array(stored.seeds),
        "state_names": np.array([p.name for p in system.state]),
        "state_units": np.array([p.unit for p in system.state]),
        "parameter_names": np.array([p.name for p in system.expert_parameters]),
        "parameter_units": np.array([p.unit for p in system.expert_parameters]),
    }
    columns = ["experiment", "system", "method", "label", "preset", "seed", "set", "metric", "value"]
    table = pd.DataFrame(rows)[columns]
    with atomic(forecasts) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    with atomic(metrics) as temporary:
        table.to_csv(temporary, index=False)
    drawn = Path(forecasts).with_name("forecasts.png"), Path(forecasts).with_name("parameters.png")
    traces.forecasts({identity["label"]: forecasts}, drawn[0], {})
    figures.parameters({identity["label"]: forecasts}, drawn[1], {})
    _log(metrics, drawn, identity, stored, settings, tracking)


def _spread(data: Trajectories, count: int | None) -> Trajectories:
    if count is None or count >= len(data):
        return data
    return data.subset(np.linspace(0, len(data) - 1, count).astype(int))


@torch.no_grad()
def _forecast(
    stored: store.StoredModel, data: Trajectories, solver: Solver, start: str, device: torch.device
) -> tuple[Tensor, Tensor | None]:
    """States (T, S, N, *state) and estimates (S, N, P) on the CPU; None where the model estimates nothing."""
    seeds, observed = len(stored.seeds), stored.description["observed"]
    t = torch.from_numpy(data.t).float().to(device)
    states, estimates = [], []
    name = "{experiment}/{label}, seeds {seeds}, (seed's place, sample)".format(**stored.description)
    for first in range(0, len(data), CHUNK):
        y = torch.from_numpy(data.y[first : first + CHUNK, :observed]).to(device).movedim(1, 0).unsqueeze(1)
        y = y.expand(observed, seeds, *y.shape[2:])
        try:
            states_of, z_e = stored.model.predict(y, t, solver, start)
        except SolveError as error:  # a fixed grid goes on, so that the sample can be named
            check_finite(*stored.model.predict(y, t, Solver("rk4"), start), name)
            raise SolveError(f"{name}: {error}") from error
        states.append(states_of.cpu())
        if z_e is not None:
            check_finite(states_of, z_e, name)
            estimates.append(z_e.cpu())
    return torch.cat(states, dim=2), torch.cat(estimates, dim=1) if estimates else None


def _score(
    stored: store.StoredModel, truth: Trajectories, prediction: Tensor, z_e: Tensor | None, start: float | None
) -> dict[str, Tensor]:
    """Every metric of one set, (S,) each."""
    system, observed = stored.model.system, stored.description["observed"]
    y = torch.from_numpy(truth.y).movedim(1, 0).unsqueeze(1)
    begin = observed if start is None else int(np.searchsorted(truth.t, start - 1e-9))
    values = log_mse(system, prediction[begin:], y[begin:])
    values["log_mse_observed"] = log_mse(system, prediction[1:observed], y[1:observed])["log_mse_sum"]
    if z_e is not None:
        values |= parameter_errors(system, z_e, torch.from_numpy(truth.z_e).unsqueeze(0))
    return values


def _collect(
    name: str, truth: Trajectories, prediction: Tensor, z_e: Tensor | None, count: int
) -> dict[str, np.ndarray]:
    """<set>_index (K,), _truth (K, T, D), _prediction (S, K, T, D), _z_e (N, P) and _z_e_hat (S, N, P)."""
    index = np.linspace(0, len(truth) - 1, min(count, len(truth)) + 2)[1:-1].astype(int)
    chosen = prediction[:, :, index].movedim(0, 2)
    arrays = {
        f"{name}_index": index,
        f"{name}_truth": truth.y[index].reshape(len(index), len(truth.t), -1),
        f"{name}_prediction": chosen.flatten(3).numpy(),
        f"{name}_z_e": truth.z_e,
    }
    return arrays | ({} if z_e is None else {f"{name}_z_e_hat": z_e.numpy()})


def _log(
    metrics: Path,
    drawn: Sequence[Path],
    identity: Mapping,
    stored: store.StoredModel,
    settings: Mapping,
    tracking: Mapping | None,
) -> None:
    with RunLog(
        Path(metrics).with_name("evaluation.jsonl"),
        tracking,
        **identity,
        stage="evaluate",
        seeds=stored.seeds,
        params={"evaluation": settings["evaluation"], "choices": settings["choices"]},
    ) as log:
        log.table(Path(metrics))
        log.artifact(Path(metrics))
        for path in drawn:
            log.artifact(path)
