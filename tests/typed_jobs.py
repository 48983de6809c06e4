"""Stages called with what a workflow's JSON says: mappings that several stages share become each stage's own job."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from expertaug.evaluation import evaluate as evaluating
from expertaug.evaluation.settings import EvaluateJob
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


def augment(model, data, output, settings):
    augmenting.run_stage(model, data, output, job(AugmentJob, settings))


def finetune(model, augmented, data, output, work, settings, tracking):
    tuning.run_stage(model, augmented, data, output, work, job(FinetuneJob, settings), tracking)


def evaluate(model, data, metrics, forecasts, settings):
    evaluating.run_stage(model, data, metrics, forecasts, job(EvaluateJob, settings))
