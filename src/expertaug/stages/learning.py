"""Stages that make simulated sets and models."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from expertaug.stages.options import add_paths, add_prior, add_tracking, tracking_of
from expertaug.stages.stage import SETS, TRAINED, Stage, StageWithPrior

if TYPE_CHECKING:
    from expertaug.inference.settings import AlternateJob, FlowJob, OwnPriorJob
    from expertaug.learning.settings import AugmentJob, FinetuneJob, TrainJob, UntrainedJob
    from expertaug.settings import Raw
    from expertaug.systems.settings import SimulateJob


class Simulate(Stage):
    """simulate one set of a system"""

    name = "simulate"
    code = "expertaug.systems.simulate"
    job = "expertaug.systems.settings:SimulateJob"
    slice = "expertaug.config.stage_settings:simulate"
    runs_methods = True

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("set", help="name of the set")
        add_paths(parser, output="npz of the trajectories")

    @staticmethod
    def run(a: argparse.Namespace, job: SimulateJob) -> None:
        from expertaug.systems.simulate import simulate

        simulate(a.set, a.output, job)


def _add_training(parser: argparse.ArgumentParser) -> None:
    add_paths(parser, data="folder of the sets", output="model file", work="folder for checkpoints")
    parser.add_argument("--calibration", type=Path, help="JSON of the expert's constants")
    add_tracking(parser)
    add_prior(parser)


class Train(StageWithPrior):
    """train a method on a group of seeds"""

    name = "train"
    code = "expertaug.learning.train"
    job = "expertaug.learning.settings:TrainJob"
    slice = "expertaug.config.stage_settings:train"
    reads = (*SETS, "calibrate", "init_tracking")
    runs_methods = True
    add_arguments = staticmethod(_add_training)

    @classmethod
    def job_of(cls, a: argparse.Namespace, settings: Raw) -> str:
        from expertaug.learning.settings import train_job_kind

        return f"{cls.job.partition(':')[0]}:{train_job_kind(settings).__name__}"

    @staticmethod
    def run(a: argparse.Namespace, job: TrainJob | UntrainedJob) -> None:
        from expertaug.learning.train import run_stage

        run_stage(a.data, a.output, a.work, job, tracking_of(a), a.calibration)


class Alternate(StageWithPrior):
    """learn an interaction model from fits of each window"""

    name = "alternate"
    code = "expertaug.inference.alternating"
    job = "expertaug.inference.settings:AlternateJob"
    slice = "expertaug.config.stage_settings:train"
    reads = (*SETS, "calibrate", "init_tracking")
    runs_methods = True
    add_arguments = staticmethod(_add_training)

    @staticmethod
    def run(a: argparse.Namespace, job: AlternateJob) -> None:
        from expertaug.inference.alternating import run_stage

        run_stage(a.data, a.output, a.work, job, tracking_of(a), a.calibration)


class Share(StageWithPrior):
    """fit what all windows share to the training windows together"""

    name = "share"
    code = "expertaug.inference.shared"
    job = "expertaug.learning.settings:UntrainedJob"
    slice = "expertaug.config.stage_settings:train"
    reads = (*SETS, "calibrate")
    runs_methods = True
    add_arguments = staticmethod(_add_training)

    @staticmethod
    def run(a: argparse.Namespace, job: UntrainedJob) -> None:
        from expertaug.inference.shared import run_stage

        run_stage(a.data, a.output, job, a.calibration)


class OwnPrior(Stage):
    """find the ranges of p⁺ from the windows that it has to cover, or up to a budget"""

    name = "own-prior"
    code = "expertaug.inference.adaptive_prior"
    job = "expertaug.inference.settings:OwnPriorJob"
    slice = "expertaug.config.stage_settings:own_prior"
    reads = (*SETS, "calibrate", "train")
    runs_methods = True

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "model file (default: none, the expert alone)"
        parser.add_argument("--model", type=Path, metavar="FILE", help=text)
        add_paths(parser, data="folder of the sets", output="JSON of the ranges")
        parser.add_argument("--calibration", type=Path, help="JSON of the expert's constants")

    @classmethod
    def job_of(cls, a: argparse.Namespace, settings: Raw) -> str:
        return "expertaug.inference.settings:FirstPriorJob" if a.model is None else cls.job

    @staticmethod
    def run(a: argparse.Namespace, job: OwnPriorJob) -> None:
        from expertaug.inference.adaptive_prior import run_stage

        print(run_stage(a.model, a.data, a.output, job, a.calibration).says)


class Augment(StageWithPrior):
    """draw augmented samples from a trained model"""

    name = "augment"
    code = "expertaug.learning.augment"
    job = "expertaug.learning.settings:AugmentJob"
    slice = "expertaug.config.stage_settings:augment"
    reads = (*SETS, *TRAINED, "own_prior")
    runs_methods = True

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        add_paths(parser, model="model file", data="folder of the sets", output="augmented samples")
        add_prior(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: AugmentJob) -> None:
        from expertaug.learning.augment import run_stage

        run_stage(a.model, a.data, a.output, job)


class Finetune(StageWithPrior):
    """fine-tune a model on real and augmented samples"""

    name = "finetune"
    code = "expertaug.learning.finetune"
    job = "expertaug.learning.settings:FinetuneJob"
    slice = "expertaug.config.stage_settings:finetune"
    reads = (*SETS, *TRAINED, "own_prior", "augment", "init_tracking")
    runs_methods = True

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        add_paths(parser, model="model file", data="folder of the sets")
        text = "augmented samples (default: none, the control on real data alone)"
        parser.add_argument("--augmented", type=Path, metavar="FILE", help=text)
        add_paths(parser, output="model file", work="folder for checkpoints")
        add_tracking(parser)
        add_prior(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: FinetuneJob) -> None:
        from expertaug.learning.finetune import run_stage

        run_stage(a.model, a.augmented, a.data, a.output, a.work, job, tracking_of(a))


class Flow(StageWithPrior):
    """learn the posterior of a trained model from its own simulations"""

    name = "flow"
    code = "expertaug.inference.flow_training"
    job = "expertaug.inference.settings:FlowJob"
    slice = "expertaug.config.stage_settings:flow"
    reads = (*SETS, *TRAINED, "own_prior", "init_tracking")
    runs_methods = True

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        paths = {"model": "model file", "data": "folder of the sets", "output": "model file"}
        add_paths(parser, **paths, work="folder for checkpoints")
        add_tracking(parser)
        add_prior(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: FlowJob) -> None:
        from expertaug.inference.flow_training import run_stage

        run_stage(a.model, a.data, a.output, a.work, job, tracking_of(a))
