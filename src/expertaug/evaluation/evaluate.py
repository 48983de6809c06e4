"""The stage evaluate: metrics and forecasts of one trained group of seeds on every set."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from expertaug.errors import InputError
from expertaug.evaluation.drawn_forecasts import drawing_of, of_own_windows
from expertaug.evaluation.products import EVALUATION_LOG, OWN_FIGURES
from expertaug.evaluation.samples import MISFIT, VERSION, arrays_of, ranks_of
from expertaug.evaluation.score import Scored, score, spread
from expertaug.files import atomic
from expertaug.inference.least_squares import refined_by, refinement_of
from expertaug.inference.store import load
from expertaug.models.store import device_of
from expertaug.tracking.log import Run, read_log
from expertaug.tracking.metrics_csv import COLUMNS
from expertaug.tracking.run_log import RunLog
from expertaug.trajectories import Trajectories
from expertaug.versions import MAIN_SETS, SHOWN_SETS


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
    identity["system"] = stored.card.system_name
    refinement = refinement_of(stored, settings.get("refinement"))
    if refinement is not None:
        stored = replace(stored, model=refined_by(stored, refinement))
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
        if len(truth.t) <= len(stored.card.t):  # longer ones have other errors, of windows that others have
            arrays |= {"t": truth.t, **arrays_of(name, truth, scored.errors, scored.z_e)}
            arrays[f"{name}_{MISFIT}"] = scored.misfit.float().numpy()
            arrays |= {f"{name}_{key}": value.float().numpy() for key, value in scored.expected.items()}
            if name != "train":
                arrays |= ranks_of(name, truth.z_e, scored.draws)
                arrays |= {} if scored.drawn is None else scored.drawn.arrays(name)
                spread_out |= scored.draws is not None
        if kept:
            arrays |= _collect(name, truth, scored)
    if spread_out and settings.get("own") and options.get("draws"):
        train, own = Trajectories.load(Path(data) / "train.npz"), {**settings["own"], "noise": options["noise"]}
        drawing = drawing_of(stored, options, np.array(stored.card.t), start, device)
        arrays |= of_own_windows(stored, train, own, options["drawn_samples"], drawing)
    rows += [
        {**identity, "seed": seed, "set": "train", "metric": "wall_s", "value": stored.card.wall_s}
        for seed in stored.seeds
    ]
    system = stored.model.system
    arrays |= {
        "version": np.array([identity[key] for key in VERSION]),
        "observed": np.array(stored.card.observed - 1),
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


def write_log(metrics: Path, model: Path, identity: Mapping, seeds: Sequence[int], settings: Mapping) -> None:
    """Write the log beside a metrics.csv; its figures are named in it before they are there.

    Its parameters are those of the training, where that has left its log beside the model, and its own: scores and
    hyperparameters stand on one run.

    Arguments:
        model: the model file that was evaluated.
        identity: {experiment, method, label, preset, system}.
        settings: as of :func:`evaluate`.
    """
    training = model.with_name("log.jsonl")
    params = dict(read_log(training).header.params) if training.is_file() else {}
    params["choices"] = {**params.get("choices", {}), **settings["choices"]}
    params["evaluation"] = settings["evaluation"]
    tags = {"rule": "evaluate", "table": f"tables/{identity['experiment']}.md"}
    run = Run(**identity, stage="evaluate", seeds=seeds, params=params, tags=tags)
    with RunLog(metrics.with_name(EVALUATION_LOG), run) as log:
        log.table(metrics)
        for path in (metrics, *map(metrics.with_name, OWN_FIGURES)):
            log.artifact(path)
