"""Stages called with what a workflow's JSON says: mappings that several stages share become each stage's own job."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from expertaug.evaluation import during_training as following
from expertaug.evaluation import evaluate as evaluating
from expertaug.evaluation.settings import DuringTrainingJob, EvaluateJob
from expertaug.inference import adaptive_prior, alternating, flow_training
from expertaug.inference.settings import AlternateJob, FirstPriorJob, FlowJob, OwnPriorJob
from expertaug.learning import augment as augmenting
from expertaug.learning import finetune as tuning
from expertaug.learning import train as training
from expertaug.learning.settings import AugmentJob, FinetuneJob, TrainJob, UntrainedJob, train_job_kind
from expertaug.settings import Settings

Job = TypeVar("Job", bound=Settings)


def job(kind: type[Job], settings: Mapping[str, Any]) -> Job:
    """A job of a kind from a mapping, of which it takes the keys that it knows."""
    return kind.from_mapping({name: value for name, value in settings.items() if name in kind.model_fields})


def train_job(settings):
    if train_job_kind(settings) is TrainJob:
        return job(TrainJob, settings)
    return job(UntrainedJob, settings | {"training": {k: v for k, v in settings["training"].items() if k == "solver"}})


def train(data, output, work, settings, tracking, calibration=None):
    training.run_stage(data, output, work, train_job(settings), tracking, calibration)


def alternate(data, output, work, settings, tracking, calibration=None):
    alternating.run_stage(data, output, work, job(AlternateJob, settings), tracking, calibration)


def augment(model, data, output, settings):
    augmenting.run_stage(model, data, output, job(AugmentJob, settings))


def finetune(model, augmented, data, output, work, settings, tracking):
    tuning.run_stage(model, augmented, data, output, work, job(FinetuneJob, settings), tracking)


def flow(model, data, output, work, settings, tracking):
    flow_training.run_stage(model, data, output, work, job(FlowJob, settings), tracking)


def own_prior(model, data, output, settings, calibration=None):
    kind = FirstPriorJob if model is None else OwnPriorJob
    return adaptive_prior.run_stage(model, data, output, job(kind, settings), calibration)


def evaluate(model, data, metrics, forecasts, settings):
    evaluating.run_stage(model, data, metrics, forecasts, job(EvaluateJob, settings))


def during_training(snapshots, data, output, work, settings, tracking):
    following.run_stage(snapshots, data, output, work, job(DuringTrainingJob, settings), tracking)
