"""Stages that cut tables of measurements into sets."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from expertaug.stages.options import add_paths
from expertaug.stages.stage import Stage

if TYPE_CHECKING:
    from expertaug.measurements.settings import CutMeasuredHorizonJob, CutMeasurementsJob


class CutMeasurements(Stage):
    """cut measurements into chunks and split them"""

    name = "cut-measurements"
    code = "expertaug.measurements.stage"
    job = "expertaug.measurements.settings:CutMeasurementsJob"
    slice = "expertaug.config.recording_settings:cut_measurements"
    runs_methods = True

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("files", type=Path, nargs="+", help="tables: CSV, Parquet or NPZ")
        add_paths(parser, output="folder of the sets")

    @staticmethod
    def run(a: argparse.Namespace, job: CutMeasurementsJob) -> None:
        from expertaug import systems
        from expertaug.measurements.stage import cut_measurements

        cut_measurements(a.files, a.output, job.files, systems.outline(job.system).names)


class CutMeasuredHorizon(Stage):
    """cut longer chunks out of the points of each set"""

    name = "cut-measured-horizon"
    code = "expertaug.measurements.horizons"
    job = "expertaug.measurements.settings:CutMeasuredHorizonJob"
    slice = "expertaug.config.recording_settings:cut_measured_horizon"
    runs_methods = True

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("files", type=Path, nargs="+", help="tables: CSV, Parquet or NPZ")
        add_paths(parser, output="npz of the set")

    @staticmethod
    def run(a: argparse.Namespace, job: CutMeasuredHorizonJob) -> None:
        from expertaug import systems
        from expertaug.measurements.horizons import cut_measured_horizon

        cut_measured_horizon(a.files, a.output, job.files, job.set, systems.outline(job.system).names)
