"""The stage that prepares the MLflow store."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from expertaug.stages.options import add_paths
from expertaug.stages.stage import Stage

if TYPE_CHECKING:
    from expertaug.tracking.settings import InitTrackingJob


class InitTracking(Stage):
    """create or upgrade the MLflow store"""

    name = "init-tracking"
    code = "expertaug.tracking.store"
    job = "expertaug.tracking.settings:InitTrackingJob"
    slice = "expertaug.config.stage_settings:init_tracking"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        add_paths(parser, output="JSON that logging stages read")

    @staticmethod
    def run(a: argparse.Namespace, job: InitTrackingJob) -> None:
        from expertaug.tracking.store import initialise

        initialise(job, a.output)
