"""Stages that make models choose the settings that fit what they are asked for, and hand on their paths."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from expertaug.inference.settings import FirstPriorJob, OwnPriorJob
from expertaug.learning.settings import TrainJob, UntrainedJob
from expertaug.stages import learning


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("hybrid", TrainJob), ("mean", UntrainedJob), ("least_squares", UntrainedJob), ("no_such_kind", TrainJob)],
)
def test_a_method_without_a_training_has_settings_of_its_own(kind, expected):
    assert learning.Train.kind_of(argparse.Namespace(), {"build": {"kind": kind}}) is expected


def test_ranges_are_found_without_a_model_before_anything_is_trained():
    assert learning.OwnPrior.kind_of(argparse.Namespace(model=None), {}) is FirstPriorJob
    assert learning.OwnPrior.kind_of(argparse.Namespace(model=Path("m")), {}) is OwnPriorJob


@pytest.mark.parametrize("augmented", [None, Path("a")])
def test_a_fine_tuning_without_augmented_samples_is_the_control(monkeypatch, augmented):
    given = []
    monkeypatch.setattr("expertaug.learning.finetune.run_stage", lambda *a: given.append(a))
    parser = argparse.ArgumentParser()
    learning.Finetune.add_arguments(parser)
    words = ["--model=m", "--data=d", "--output=o", "--work=w", *([f"--augmented={augmented}"] if augmented else [])]
    learning.Finetune.run(parser.parse_args(words), "job")
    assert given == [(Path("m"), augmented, Path("d"), Path("o"), Path("w"), "job", None)]


def test_trainings_are_told_the_experts_constants_where_there_are_some(monkeypatch):
    given = []
    monkeypatch.setattr("expertaug.learning.train.run_stage", lambda *a: given.append(a))
    parser = argparse.ArgumentParser()
    learning.Train.add_arguments(parser)
    words = ["--data=d", "--output=o", "--work=w"]
    for more in ([], ["--calibration=c"]):
        learning.Train.run(parser.parse_args([*words, *more]), "job")
    paths = Path("d"), Path("o"), Path("w")
    assert given == [(*paths, "job", None, None), (*paths, "job", None, Path("c"))]
