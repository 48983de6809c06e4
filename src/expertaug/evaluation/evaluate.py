"""The stage evaluate: metrics and forecasts of one trained group of seeds on every set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import torch

from expertaug.errors import InputError
from expertaug.evaluation.forecasting import drawing_of, of_simulations, score_draws
from expertaug.evaluation.forecasts import Forecasts, KeptForecasts, SetForecasts, VersionKey, constants_of
from expertaug.evaluation.products import EVALUATION_LOG, OWN_FIGURES
from expertaug.evaluation.score import Scored, score
from expertaug.evaluation.settings import EvaluateJob
from expertaug.inference.flow import StoredModel, load
from expertaug.inference.least_squares import refine_by, refinement_of, with_overdispersion
from expertaug.inference.shared import on_training_windows
from expertaug.models.store import device_of
from expertaug.rows import write_csv
from expertaug.tracking.log import Run, read_log
from expertaug.tracking.metrics_csv import MetricRow
from expertaug.tracking.run_log import RunLog
from expertaug.trajectories import SetFolder, Trajectories
from expertaug.versions import SHOWN_SETS


@dataclass(frozen=True)
class Evaluation:
    """What an evaluation says of a group of seeds.

    Attributes:
        rows: the metrics of every seed and set.
        forecasts: kept of validation, iid and test alone; errors of every sample of all sets that are no longer than
            the training's.
    """

    rows: list[MetricRow]
    forecasts: Forecasts


def run_stage(model: Path, data: Path, metrics: Path, forecasts: Path, job: EvaluateJob) -> None:
    """Stage: write the metrics of every seed and set, and forecasts of chosen samples.

    Arguments:
        model: file of the trained model.
        data: folder of the sets.
        metrics: CSV in long format (:class:`expertaug.tracking.metrics_csv.MetricRow`).
        forecasts: npz (:mod:`expertaug.evaluation.forecasts`).

    Raises:
        InputError: the model and the job disagree on the seeds.
    """
    stored = load(model, device_of(job.device), job.classes or ())
    evaluation = evaluate(stored, SetFolder(data), job)
    evaluation.forecasts.save(forecasts)
    write_csv(Path(metrics), MetricRow, evaluation.rows)
    write_log(Path(metrics), Path(model), stored, job)


def evaluate(stored: StoredModel, sets: Mapping[str, Trajectories], job: EvaluateJob) -> Evaluation:
    """Score a trained model's forecasts on every set.

    Arguments:
        sets: train, and those of the job. They are asked for one after the other, and train alone is kept: a
            :class:`~expertaug.trajectories.SetFolder` needs no memory for the others.

    Raises:
        InputError: the model and the job disagree on the seeds.
    """
    device, scoring = device_of(job.device), job.evaluation
    if stored.seeds != job.seeds:
        raise InputError(stored.where, f"holds seeds {stored.seeds}", f"expected {job.seeds}: train again")
    start = job.choices.forecast_start
    refinement = refinement_of(stored, job.refinement)
    train = cache(lambda: sets["train"])
    if refinement is not None:
        if job.refinement is not None:
            refinement = on_training_windows(stored, refinement, train())
        refinement = with_overdispersion(stored, refinement, train())
        stored = replace(stored, model=refine_by(stored, refinement), card=stored.card.but(refinement=refinement))
    identity = (job.experiment, stored.card.system_name, job.method, job.label, job.preset)
    rows: list[MetricRow] = []
    of_sets: dict[str, SetForecasts] = {}
    t, rank_draws, distributed = np.array([]), None, False
    for name in job.sets:
        whole = train() if name == "train" else sets[name]
        truth = whole.spread(scoring.max_samples)
        if name == "train":
            truth = truth.spread(scoring.train_samples)
        if job.known is not None:
            wanted = [p.name for p in stored.model.system.expert_parameters]
            truth = truth.with_parameters(job.known.z_e, job.known.z_a, wanted)
        shown = name in SHOWN_SETS[1:]
        how = scoring if shown else scoring.without_draws
        scored = score(stored, truth, how, start, device, scoring.samples if shown else 0, job.noise)
        rows += [
            MetricRow(*identity, seed, name, metric, value) for metric, seed, value in scored.of_seeds(stored.seeds)
        ]
        set_forecasts = SetForecasts(z_e=truth.z_e)
        if len(truth.t) <= len(stored.card.t):  # longer ones have other errors, of windows that others have
            t, set_forecasts = truth.t, _of_every_sample(name, truth, scored)
            distributed |= name != "train" and scored.draws is not None
            if set_forecasts.ranks is not None and scored.draws is not None:
                rank_draws = scored.draws.shape[2]
        if shown:
            set_forecasts = replace(set_forecasts, kept=_of_chosen_samples(truth, scored))
        if shown or set_forecasts.errors is not None:
            of_sets[name] = set_forecasts
    own = None
    if distributed and job.own is not None and scoring.draws:
        drawing = drawing_of(stored, scoring, job.noise, np.array(stored.card.t), start, device)
        own, own_draws = of_simulations(stored, train(), job.own, job.noise, scoring.drawn_samples, drawing)
        rank_draws = own_draws if own is not None and own.ranks is not None else rank_draws
    rows += [MetricRow(*identity, seed, "train", "wall_s", stored.card.wall_s) for seed in stored.seeds]
    system = stored.model.system
    parameters = [*system.expert_parameters, *(system.interaction_parameters if stored.card.truth else ())]
    forecasts = Forecasts(
        t=t,
        observed=stored.card.observed - 1,
        seeds=stored.seeds,
        state_names=[p.name for p in system.state],
        state_units=[p.unit for p in system.state],
        parameter_names=[p.name for p in system.expert_parameters],
        parameter_units=[p.unit for p in system.expert_parameters],
        sets=of_sets,
        failed=stored.failed,
        interaction_names=[p.name for p in getattr(system, "interaction_parameters", ())],
        estimated_names=[p.name for p in parameters],
        estimated_units=[p.unit for p in parameters],
        positive_names=[p.name for p in parameters if p.positive],
        shared=stored.card.shared_groups,
        constants=constants_of(refinement, *({p.name: p.unit for p in of} for of in (parameters, system.state))),
        version=VersionKey(job.experiment, job.preset, job.method),
        rank_draws=rank_draws,
        own=own,
    )
    return Evaluation(rows, forecasts)


def _of_every_sample(name: str, truth: Trajectories, scored: Scored) -> SetForecasts:
    """What is kept of every sample of a set; estimates and draws not of the training set."""

    def array(values: torch.Tensor | None) -> np.ndarray | None:
        return None if values is None else values.float().numpy()

    is_train = name == "train"
    set_forecasts = SetForecasts() if is_train else score_draws(truth.z_e, scored.draws, scored.drawn)
    return replace(
        set_forecasts,
        errors=array(scored.errors),
        misfit=array(scored.misfit),
        z_e=truth.z_e,
        z_a=truth.z_a if truth.z_a.shape[1] else None,
        z_e_hat=None if is_train or scored.z_e is None else scored.z_e.numpy(),
        sample_id=truth.id,
        estimated=array(scored.stated),
        estimated_std=array(scored.stated_std),
        expected=array(scored.expected),
        moved=array(scored.moved),
        median=array(scored.median),
    )


def _of_chosen_samples(truth: Trajectories, scored: Scored) -> KeptForecasts:
    return KeptForecasts(
        index=scored.index,
        truth=truth.seen[scored.index],
        prediction=scored.prediction.numpy(),
        band=None if scored.band is None else scored.band.numpy(),
        id=None if truth.id is None else truth.id[scored.index],
    )


def write_log(metrics: Path, model: Path, stored: StoredModel, job: EvaluateJob) -> None:
    """Write the log beside a metrics.csv; its figures are named in it before they are there.

    Its parameters are those of the training, where that has left its log beside the model, and its own: scores and
    hyperparameters stand on one run.

    Arguments:
        model: the model file that was evaluated.
        stored: what it holds.
    """
    training = model.with_name("log.jsonl")
    params = dict(read_log(training).header.params) if training.is_file() else {}
    params["choices"] = {**params.get("choices", {}), **job.choices.to_json()}
    params["evaluation"] = job.evaluation.to_json()
    run = Run(
        experiment=job.experiment,
        method=job.method,
        label=job.label,
        preset=job.preset,
        system=stored.card.system_name,
        stage="evaluate",
        seeds=tuple(stored.seeds),
        params=params,
        tags={"rule": "evaluate", "table": f"tables/{job.experiment}.md"},
    )
    with RunLog(metrics.with_name(EVALUATION_LOG), run) as log:
        log.table(metrics)
        for path in (metrics, *map(metrics.with_name, OWN_FIGURES)):
            log.artifact(path)
