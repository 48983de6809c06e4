"""The stage evaluate: metrics and forecasts of one trained group of seeds on every set."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.evaluation.evaluation_log import write_log
from expertaug.evaluation.metrics import log_after, log_of, log_of_median, parameter_errors, squared_errors
from expertaug.evaluation.runaways import forecast
from expertaug.evaluation.samples import MISFIT, VERSION, arrays_of, ranks_of
from expertaug.files import atomic
from expertaug.inference.least_squares import estimator_of
from expertaug.inference.posterior_draws import z_e_draws
from expertaug.inference.store import load
from expertaug.labels import MAIN_SETS, SHOWN_SETS
from expertaug.learning.bound import largest, stored_bound
from expertaug.models import store
from expertaug.models.device import device_of
from expertaug.systems.solver import Solver
from expertaug.tracking.log_file import COLUMNS
from expertaug.trajectories import Trajectories

CHUNK_BYTES = 2**25  # of the forecasts made at a time: bounds the memory, whatever the size of a state


def evaluate(model: Path, data: Path, metrics: Path, forecasts: Path, settings: Mapping) -> None:
    """Write the metrics of every seed and set, and forecasts of chosen samples.

    Arguments:
        model: file of the trained model.
        data: folder of the sets.
        metrics: CSV in long format (experiment, system, method, label, preset, seed, set, metric, value).
        forecasts: npz; its arrays are named in :func:`_collect` and :func:`arrays_of`.
        settings: {experiment, method, label, preset, sets, evaluation, choices, seeds, device}; ``sets`` names those to
            evaluate (forecasts are kept of validation, iid and test alone, errors of every sample of all that are no
            longer than the training's); ``evaluation`` has
            ``samples`` (forecasts kept of each set), ``from_s`` (the metric sees times from there on; null = those
            after the observed window, which ``log_mse_after_sum`` and ``_dim`` see alone where others count too),
            ``max_samples`` (of each set, evenly spread; null = all) and ``solver``; ``refinement``
            ({settings, noise, prior}, as :func:`estimator_of`): the model's estimates are refined by least squares.

    Raises:
        InputError: the model and the settings disagree on the seeds.
    """
    device = device_of(settings["device"])
    stored = load(model, device, settings.get("classes", ()))
    if stored.seeds != list(settings["seeds"]):
        raise InputError(model, f"holds seeds {stored.seeds}", f"expected {list(settings['seeds'])}: train again")
    options = settings["evaluation"]
    start = settings["choices"]["forecast_start"]
    identity = {k: settings[k] for k in ("experiment", "method", "label", "preset")}
    identity["system"] = stored.description["system"]["name"]
    refinement = settings.get("refinement") or stored.description.get("refinement")
    if refinement is not None:
        stored = replace(stored, model=estimator_of(stored, **refinement))
    rows, arrays = [], {}
    for name in settings.get("sets", MAIN_SETS):
        truth = spread(Trajectories.load(Path(data) / f"{name}.npz"), options.get("max_samples"))
        kept = int(options.get("samples", 3)) if name in SHOWN_SETS[1:] else 0
        scored = score(stored, truth, options, start, device, kept)
        rows += scored.rows(identity | {"set": name}, stored.seeds)
        if len(truth.t) <= len(stored.description["t"]):  # longer ones have other errors, of windows that others have
            arrays |= {"t": truth.t, **arrays_of(name, truth, scored.errors, scored.z_e)}
            arrays[f"{name}_{MISFIT}"] = scored.misfit.float().numpy()
            arrays |= ranks_of(name, truth, scored.draws) if name != "train" else {}
        if kept:
            arrays |= _collect(name, truth, scored)
    rows += [
        {**identity, "seed": seed, "set": "train", "metric": "wall_s", "value": stored.description["wall_s"]}
        for seed in stored.seeds
    ]
    system = stored.model.system
    arrays |= {
        "version": np.array([identity[key] for key in VERSION]),
        "observed": np.array(stored.description["observed"] - 1),
        "seeds": np.array(stored.seeds),
        "failed": np.array(stored.failed, dtype=int),
        "state_names": np.array([p.name for p in system.state]),
        "state_units": np.array([p.unit for p in system.state]),
        "parameter_names": np.array([p.name for p in system.expert_parameters]),
        "parameter_units": np.array([p.unit for p in system.expert_parameters]),
    }
    with atomic(forecasts) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    with atomic(metrics) as temporary:
        _write(temporary, rows)
    write_log(Path(metrics), identity, stored.seeds, settings)


@dataclass(frozen=True)
class Scored:
    """What a forecast of one set gave.

    Attributes:
        values: metric → (S,).
        index: samples whose forecasts are kept, (K,).
        prediction: these forecasts, (S, K, T, *state).
        z_e: estimates (S, N, P), or None where the model estimates nothing.
        errors: squared error of every sample (S, N), as of :func:`squared_errors`; NaN of seeds that failed.
        draws: of z_e (S, N, K, P), where the estimator has a distribution.
        misfit: the same over the observed window after its first point, which needs no truth.
    """

    values: Mapping[str, Tensor]
    index: np.ndarray
    prediction: Tensor
    z_e: Tensor | None
    errors: Tensor
    misfit: Tensor
    draws: Tensor | None

    def rows(self, identity: Mapping, seeds: Sequence[int]) -> list[dict]:
        """Rows of a metrics.csv."""
        return [
            {**identity, "seed": seed, "metric": metric, "value": float(value[k])}
            for metric, value in self.values.items()
            for k, seed in enumerate(seeds)
        ]


def spread(data: Trajectories, count: int | None) -> Trajectories:
    """At most ``count`` samples, evenly spread; None = all."""
    if count is None or count >= len(data):
        return data
    return data.subset(np.linspace(0, len(data) - 1, count).astype(int))


@torch.no_grad()
def score(
    stored: store.StoredModel, truth: Trajectories, options: Mapping, start: str, device: torch.device, keep: int = 0
) -> Scored:
    """Forecast a set, part by part, and score it; seeds that could not be trained have NaN.

    A forecast that runs away counts with the error that it has at the bound, and in ``runaway_share``.

    Arguments:
        options: ``from_s`` and ``solver``, as in :func:`evaluate`.
        start: y0 or y_t1 (:meth:`Predictor.predicted`).
        keep: number of forecasts to keep, evenly spread.
    """
    system, observed, seeds = stored.model.system, stored.description["observed"], len(stored.seeds)
    solver = Solver.from_mapping(options.get("solver") or {"method": "dopri5", "rtol": 1e-6, "atol": 1e-6})
    t = torch.from_numpy(truth.t).float().to(device)
    bound = stored_bound(stored.description, device)
    if bound is not None:  # what turns at one speed goes as far as the time is long
        bound = bound * max(1.0, float(truth.t[-1]) / stored.description["t"][-1])
    begin = observed
    if options.get("from_s") is not None:
        begin = int(np.searchsorted(truth.t, options["from_s"] - 1e-9))
    index = np.linspace(0, len(truth) - 1, min(keep, len(truth)) + 2)[1:-1].astype(int)
    size = max(1, CHUNK_BYTES // (seeds * truth.y[0].nbytes))
    late, early, after, estimates, kept, runaways, drawn = [], [], [], [], [], [], []
    for first in range(0, len(truth), size):
        y = torch.from_numpy(truth.y[first : first + size]).to(device).movedim(1, 0).unsqueeze(1)
        limit = None if bound is None else torch.maximum(bound, largest(y[:, 0]))  # to follow the truth is not to run
        found = forecast(stored.model, y[:observed].expand(-1, seeds, *y.shape[2:]), t, solver, start, limit)
        late.append(squared_errors(system, found.states[begin:], y[begin:]).cpu())
        early.append(squared_errors(system, found.states[1:observed], y[1:observed]).cpu())
        if begin < observed:
            after.append(squared_errors(system, found.states[observed:], y[observed:]).cpu())
        kept.append(found.states[:, :, index[(index >= first) & (index < first + size)] - first].cpu())
        runaways.append(found.runaways.cpu())
        if found.found.z_e is not None and stored.model.knows_z_e:
            estimates.append(found.found.z_e.cpu())
            of_each = z_e_draws(found.found)
            drawn += [] if of_each is None else [of_each.cpu()]
    errors = torch.cat(late, dim=1)
    values = log_of(system, errors)
    misfit = torch.cat(early, dim=1)
    values["log_mse_observed"] = log_of(system, misfit)["log_mse_sum"]
    if after:
        values |= log_after(system, torch.cat(after, dim=1))
    values |= log_of_median(system, errors)
    values["runaway_share"] = torch.cat(runaways, dim=1).double().mean(1)
    z_e = torch.cat(estimates, dim=1) if estimates else None
    if z_e is not None:
        values |= parameter_errors(system, z_e, torch.from_numpy(truth.z_e).unsqueeze(0))
    failed = torch.tensor([seed in stored.failed for seed in stored.seeds])
    values = {name: value.masked_fill(failed, math.nan) for name, value in values.items()}
    errors, misfit = (each.masked_fill(failed.unsqueeze(1), math.nan) for each in (errors, misfit))
    return Scored(
        values,
        index,
        torch.cat(kept, dim=2).movedim(0, 2),
        z_e,
        errors,
        misfit,
        torch.cat(drawn, dim=1) if drawn else None,
    )


def _collect(name: str, truth: Trajectories, scored: Scored) -> dict[str, np.ndarray]:
    """<set>_index (K,), _truth (K, T, *state), _prediction (S, K, T, *state) and, where samples have one, _id (K,)."""
    arrays = {
        f"{name}_index": scored.index,
        f"{name}_truth": truth.y[scored.index],
        f"{name}_prediction": scored.prediction.numpy(),
    }
    return arrays if truth.id is None else arrays | {f"{name}_id": truth.id[scored.index]}


def _write(path: Path, rows: Sequence[Mapping]) -> None:
    """A metrics.csv; nothing stands for a number that is none."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        table.writeheader()
        for row in rows:
            table.writerow(row | ({"value": ""} if math.isnan(row["value"]) else {}))
