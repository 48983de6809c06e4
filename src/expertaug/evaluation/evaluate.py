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
from expertaug.evaluation.expected_error import ExpectedError
from expertaug.evaluation.forecast_scores import DRAWN, DrawnScores, drawing_of
from expertaug.evaluation.metrics import log_after, log_of, log_of_median, parameter_errors, squared_errors
from expertaug.evaluation.own_windows import of_own_windows
from expertaug.evaluation.runaways import forecast
from expertaug.evaluation.samples import MISFIT, VERSION, arrays_of, drawn_arrays, ranks_of
from expertaug.files import atomic
from expertaug.inference.least_squares import estimator_of
from expertaug.inference.posterior_draws import z_e_draws
from expertaug.inference.store import load
from expertaug.labels import MAIN_SETS, SHOWN_SETS
from expertaug.learning.bound import largest, stored_bound
from expertaug.learning.misfit import misfit_of
from expertaug.learning.noise import Noise
from expertaug.models import store
from expertaug.models.device import device_of
from expertaug.systems.inputs import check_given, joined
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
            ``max_samples`` and ``train_samples`` (of each set, and of the training set, evenly spread; null = all),
            ``solver``, and ``draws`` and ``drawn_samples``: how many forecasts are drawn of how many windows of each
            set, where a version has a distribution, ``expected_draws``, of every window, and ``draws_solver``, with
            which (default the same);
            ``noise``, standard deviation of the data's noise; ``refinement`` ({settings, noise, prior}, as
            :func:`estimator_of`): the model's estimates are refined by least squares; ``own`` ({prior, resample_x,
            z_a_from}): windows of the model's own making are one more set, of ranks and scores of draws alone.

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
    rows, arrays, spread_out = [], {}, False
    options = {**options, "noise": settings.get("noise", 0.0)}
    for name in settings.get("sets", MAIN_SETS):
        truth = spread(Trajectories.load(Path(data) / f"{name}.npz"), options.get("max_samples"))
        if name == "train":
            truth = spread(truth, options.get("train_samples"))
        kept = int(options.get("samples", 3)) if name in SHOWN_SETS[1:] else 0
        plain = options if name in SHOWN_SETS[1:] else {**options, "draws": 0}
        scored = score(stored, truth, plain, start, device, kept)
        rows += scored.rows(identity | {"set": name}, stored.seeds)
        if len(truth.t) <= len(stored.description["t"]):  # longer ones have other errors, of windows that others have
            arrays |= {"t": truth.t, **arrays_of(name, truth, scored.errors, scored.z_e)}
            arrays[f"{name}_{MISFIT}"] = scored.misfit.float().numpy()
            arrays |= {f"{name}_{key}": value.float().numpy() for key, value in scored.expected.items()}
            if name != "train":
                arrays |= ranks_of(name, truth.z_e, scored.draws) | drawn_arrays(name, scored.drawn)
                spread_out |= scored.draws is not None
        if kept:
            arrays |= _collect(name, truth, scored)
    if spread_out and settings.get("own") and options.get("draws"):
        train, own = Trajectories.load(Path(data) / "train.npz"), {**settings["own"], "noise": options["noise"]}
        drawing = drawing_of(stored, options, np.array(stored.description["t"]), start, device)
        arrays |= of_own_windows(stored, train, own, options["drawn_samples"], drawing)
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
        "interaction_names": np.array([p.name for p in getattr(system, "interaction_parameters", ())], dtype=str),
        "parameter_names": np.array([p.name for p in system.expert_parameters]),
        "parameter_units": np.array([p.unit for p in system.expert_parameters]),
    }
    with atomic(forecasts) as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
    with atomic(metrics) as temporary:
        _write(temporary, rows)
    write_log(Path(metrics), Path(model), identity, stored.seeds, settings)


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
        expected: what is expected of the errors (:class:`ExpectedError`), each (S, N).
        drawn: scores of forecasts from draws, where there are any.
        band: of the kept forecasts, (2, S, K, T, *state): ends of the 90 % band.
    """

    values: Mapping[str, Tensor]
    index: np.ndarray
    prediction: Tensor
    z_e: Tensor | None
    errors: Tensor
    misfit: Tensor
    expected: Mapping[str, Tensor]
    draws: Tensor | None
    drawn: DrawnScores | None = None
    band: Tensor | None = None

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

    A forecast that runs away counts with the error that it has at the bound, and in ``runaway_share``.  ``estimate_ms``
    is the processor time in which one seed estimates one window's parameters, all windows at once.

    Arguments:
        options: what ``evaluation`` has in :func:`evaluate`, and ``noise``.
        start: y0 or y_t1 (:meth:`Predictor.predicted`).
        keep: number of forecasts to keep, evenly spread.
    """
    system, observed, seeds = stored.model.system, stored.description["observed"], len(stored.seeds)
    drawing = drawing_of(stored, options, truth.t, start, device)
    t, begin, solver = drawing.t, drawing.begin, drawing.solver
    bound = stored_bound(stored.description, device)
    if bound is not None:  # what turns at one speed goes as far as the time is long
        bound = bound * max(1.0, float(truth.t[-1]) / stored.description["t"][-1])
    index = np.linspace(0, len(truth) - 1, min(keep, len(truth)) + 2)[1:-1].astype(int)
    check_given(system, None if truth.u is None else torch.from_numpy(truth.u), "set")
    size = max(1, CHUNK_BYTES // (seeds * truth.y[0].nbytes))
    late, early, after, estimates, kept, runaways, drawn, estimate_s = [], [], [], [], [], [], [], 0.0
    few = min(drawing.count, options.get("expected_draws", drawing.count))
    expected = ExpectedError(stored.model, replace(drawing, count=few))
    chosen = np.linspace(0, len(truth) - 1, min(options.get("drawn_samples", 0), len(truth))).astype(int)
    scores, bands, random = [], [], Noise(stored.seeds, DRAWN, device=device)
    seen = truth.seen
    for first in range(0, len(truth), size):
        y = torch.from_numpy(seen[first : first + size]).to(device).movedim(1, 0).unsqueeze(1)
        limit = None if bound is None else torch.maximum(bound, largest(y[:, 0]))  # to follow the truth is not to run
        u = None
        if truth.u is not None:
            u = torch.from_numpy(truth.u[first : first + size]).to(device).movedim(1, 0).unsqueeze(1)
            u = u.expand(-1, seeds, *u.shape[2:])
        windows = joined(y[:observed].expand(-1, seeds, *y.shape[2:]), None if u is None else u[:observed])
        found = forecast(stored.model, windows, t, solver, start, limit, u)
        late.append(squared_errors(system, found.states[begin:], y[begin:]).cpu())
        early.append(misfit_of(system, found.states, y[:observed]).cpu())
        whole = joined(y.expand(-1, seeds, *y.shape[2:]), u)
        expected.add(found, whole, windows, limit, u)
        if begin < observed:
            after.append(squared_errors(system, found.states[observed:], y[observed:]).cpu())
        here = index[(index >= first) & (index < first + size)] - first
        kept.append(found.states[:, :, here].cpu())
        runaways.append(found.runaways.cpu())
        estimate_s += found.estimate_s
        if found.found.z_e is not None and stored.model.knows_z_e:
            estimates.append(found.found.z_e.cpu())
            of_each = z_e_draws(found.found)
            drawn += [] if of_each is None else [of_each.cpu()]
        if drawing.count and found.found.z_e is not None:
            places = chosen[(chosen >= first) & (chosen < first + size)] - first
            for wanted, made, at in ((drawing.scores, scores, places), (drawing.band, bands, here)):
                some = torch.from_numpy(at).to(device)
                bounds = limit if limit is None or limit.dim() == 1 else limit[some]
                part = found.found.part(some), whole[:, :, some]
                one = wanted(stored.model, *part, bounds, random) if len(at) else None
                made += [] if one is None else [one]
    errors = torch.cat(late, dim=1)
    values = log_of(system, _told(errors))
    misfit = torch.cat(early, dim=1)
    values["log_mse_observed"] = log_of(system, _told(misfit))["log_mse_sum"]
    if after:
        values |= log_after(system, _told(torch.cat(after, dim=1)))
    values |= log_of_median(system, _told(errors))
    values["runaway_share"] = torch.cat(runaways, dim=1).double().mean(1)
    if found.found.z_e is not None:
        values["estimate_ms"] = torch.full((seeds,), 1000 * estimate_s / (seeds * len(truth)), dtype=torch.float64)
    z_e = torch.cat(estimates, dim=1) if estimates else None
    if z_e is not None:
        values |= parameter_errors(system, z_e, torch.from_numpy(truth.z_e).unsqueeze(0))
    of_draws = DrawnScores.joined(scores)
    values |= {} if of_draws is None else of_draws.metrics()
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
        expected.joined(),
        torch.cat(drawn, dim=1) if drawn else None,
        of_draws,
        torch.cat(bands, dim=3).movedim(1, 3).cpu() if bands and len(system.state_shape) == 1 else None,
    )


def _told(errors: Tensor) -> Tensor:
    """Errors (S, N) of the samples of which anything was measured at these times."""
    untold = torch.isnan(errors).all(0)
    return errors[:, ~untold] if untold.any() else errors


def _collect(name: str, truth: Trajectories, scored: Scored) -> dict[str, np.ndarray]:
    """<set>_index (K,), _truth (K, T, *state), _prediction (S, K, T, *state), where forecasts are drawn _band
    (2, S, K, T', *state), of the last T' times, and, where samples have one, _id (K,)."""
    arrays = {
        f"{name}_index": scored.index,
        f"{name}_truth": truth.seen[scored.index],
        f"{name}_prediction": scored.prediction.numpy(),
    }
    if scored.band is not None:
        arrays[f"{name}_band"] = scored.band.numpy()
    return arrays if truth.id is None else arrays | {f"{name}_id": truth.id[scored.index]}


def _write(path: Path, rows: Sequence[Mapping]) -> None:
    """A metrics.csv; nothing stands for a number that is none."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        table = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
        table.writeheader()
        for row in rows:
            table.writerow(row | ({"value": ""} if math.isnan(row["value"]) else {}))
