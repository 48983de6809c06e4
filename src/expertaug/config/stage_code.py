"""Which files of this package a stage is made of, so that the workflow redoes it when one of them changes."""

from __future__ import annotations

import os
from collections.abc import Iterable

from expertaug import source_files

# Stage → the module whose public function does its work.
STAGES = {
    "init_tracking": "expertaug.tracking.store",
    "render_video": "expertaug_recordings.rendering.render",
    "extract_frames": "expertaug_recordings.video.frame_store",
    "track_markers": "expertaug_recordings.markers.track",
    "unpack_markers": "expertaug_recordings.ibm",
    "import_markers": "expertaug_recordings.ibm",
    "measure_angles": "expertaug_recordings.angles.measure",
    "summarise_recordings": "expertaug_recordings.reports.summary",
    "plot_recording": "expertaug_recordings.reports.page",
    "overlay": "expertaug_recordings.reports.overlay",
    "cut_measurements": "expertaug.measurements.stage",
    "cut_measured_horizon": "expertaug.measurements.horizons",
    "review_recording": "expertaug_recordings.reports.review",
    "review": "expertaug_recordings.reports.review",
    "export_recording": "expertaug_recordings.reports.exports",
    "split_chunks": "expertaug_recordings.chunks",
    "cut_horizon": "expertaug_recordings.chunks",
    "plot_splits": "expertaug_recordings.reports.splits",
    "calibrate": "expertaug_recordings.angles.calibration",
    "simulate": "expertaug.systems.simulate",
    "train": "expertaug.learning.train",
    "alternate": "expertaug.inference.alternate",
    "augment": "expertaug.learning.augment",
    "finetune": "expertaug.learning.finetune",
    "own_prior": "expertaug.inference.prior_stage",
    "validity": "expertaug.evaluation.validity",
    "own_priors": "expertaug.evaluation.own_priors",
    "flow": "expertaug.inference.flow_training",
    "during_training": "expertaug.evaluation.during_training",
    "evaluate": "expertaug.evaluation.evaluate",
    "log_evaluations": "expertaug.evaluation.log_evaluations",
    "tabulate": "expertaug.evaluation.tabulate",
    "plot": "expertaug.evaluation.plot",
    "study": "expertaug.evaluation.studies",
    "alarm": "expertaug.evaluation.alarms",
    "coverage": "expertaug.evaluation.coverage",
    "distance": "expertaug.evaluation.distance",
    "grid": "expertaug.evaluation.grid",
    "compare": "expertaug.evaluation.published",
    "dissipation": "expertaug.evaluation.dissipation",
    "overview": "expertaug.evaluation.dots",
    "report": "expertaug.evaluation.report.page",
}


def sources(stage: str, extra: Iterable[str] = ()) -> list[str]:
    """Source files of a stage, relative to the working directory.

    Arguments:
        stage: a key of :data:`STAGES`.
        extra: modules that the configuration names: ``package.module`` or ``package.module:Class``.

    Raises:
        InputError: a module does not exist.
    """
    return [os.path.relpath(file) for file in source_files.files([STAGES[stage], *extra])]


def versions(stage: str, extra: Iterable[str] = ()) -> list[str]:
    """Installed versions of the packages that compute a stage's numbers."""
    return source_files.versions([STAGES[stage], *extra])
