"""Subcommands that make data sets and models."""

from __future__ import annotations

import argparse
from pathlib import Path

from expertaug.commands.options import (
    Commands,
    add_paths,
    add_prior,
    add_tracking,
    job_of,
    read_settings,
    settings_of,
    tracking_of,
)


def add_to(commands: Commands) -> None:
    """Add this module's subcommands."""
    p = commands.add("simulate", _simulate, "simulate one set of a system")
    p.add_argument("set", help="name of the set")
    add_paths(p, output="npz of the trajectories")

    p = commands.add("calibrate", _calibrate, "fit the expert's constants on training chunks")
    p.add_argument("train", type=Path, help="train.npz")
    add_paths(p, output="JSON of the constants")

    p = commands.add("train", _train, "train a method on a group of seeds")
    add_paths(p, data="folder of the sets", output="model file", work="folder for checkpoints")
    p.add_argument("--calibration", type=Path, help="JSON of the expert's constants")
    add_tracking(p)
    add_prior(p)

    p = commands.add("alternate", _alternate, "learn an interaction model from fits of each window")
    add_paths(p, data="folder of the sets", output="model file", work="folder for checkpoints")
    p.add_argument("--calibration", type=Path, help="JSON of the expert's constants")
    add_tracking(p)
    add_prior(p)

    text = "find the ranges of p⁺ from the windows that it is to cover, or until a budget"
    p = commands.add("own-prior", _own_prior, text)
    p.add_argument("--model", type=Path, metavar="FILE", help="model file (default: none, the expert alone)")
    add_paths(p, data="folder of the sets", output="JSON of the ranges")
    p.add_argument("--calibration", type=Path, help="JSON of the expert's constants")

    p = commands.add("augment", _augment, "draw augmented samples from a trained model")
    add_paths(p, model="model file", data="folder of the sets", output="augmented samples")
    add_prior(p)

    p = commands.add("finetune", _finetune, "fine-tune a model on real and augmented samples")
    add_paths(p, model="model file", data="folder of the sets")
    text = "augmented samples (default: none, the control on real data alone)"
    p.add_argument("--augmented", type=Path, metavar="FILE", help=text)
    add_paths(p, output="model file", work="folder for checkpoints")
    add_tracking(p)
    add_prior(p)

    p = commands.add("flow", _flow, "learn the posterior of a trained model from its own draws")
    add_paths(p, model="model file", data="folder of the sets", output="model file", work="folder for checkpoints")
    add_tracking(p)
    add_prior(p)


def _calibrate(a: argparse.Namespace) -> None:
    from expertaug_recordings.angles.calibration import calibrate
    from expertaug_recordings.settings import CalibrateJob

    calibrate(a.train, a.output, CalibrateJob.from_mapping(read_settings(a.settings)))


def _simulate(a: argparse.Namespace) -> None:
    from expertaug.systems.settings import SimulateJob

    job = SimulateJob.from_mapping(read_settings(a.settings))
    from expertaug.systems.simulate import simulate

    simulate(a.set, a.output, job)


def _train(a: argparse.Namespace) -> None:
    from expertaug.learning.settings import train_job_kind

    settings = settings_of(a)
    settings = job_of(train_job_kind(settings), settings)
    from expertaug.learning.train import train

    train(a.data, a.output, a.work, settings, tracking_of(a), a.calibration)


def _alternate(a: argparse.Namespace) -> None:
    from expertaug.inference.settings import AlternateJob

    settings = job_of(AlternateJob, settings_of(a))
    from expertaug.inference.alternate import alternate

    alternate(a.data, a.output, a.work, settings, tracking_of(a), a.calibration)


def _own_prior(a: argparse.Namespace) -> None:
    from expertaug.inference.settings import FirstPriorJob, OwnPriorJob

    settings = job_of(FirstPriorJob if a.model is None else OwnPriorJob, read_settings(a.settings))
    from expertaug.inference.prior_stage import own_prior

    print(own_prior(a.model, a.data, a.output, settings, a.calibration).says)


def _augment(a: argparse.Namespace) -> None:
    from expertaug.learning.settings import AugmentJob

    settings = job_of(AugmentJob, settings_of(a))
    from expertaug.learning.augment import augment

    augment(a.model, a.data, a.output, settings)


def _finetune(a: argparse.Namespace) -> None:
    from expertaug.learning.settings import FinetuneJob

    settings = job_of(FinetuneJob, settings_of(a))
    from expertaug.learning.finetune import finetune

    finetune(a.model, a.augmented, a.data, a.output, a.work, settings, tracking_of(a))


def _flow(a: argparse.Namespace) -> None:
    from expertaug.inference.settings import FlowJob

    settings = job_of(FlowJob, settings_of(a))
    from expertaug.inference.flow_training import flow

    flow(a.model, a.data, a.output, a.work, settings, tracking_of(a))
