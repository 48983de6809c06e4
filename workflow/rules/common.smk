"""Helpers of the rules; what is in the configuration and the package is asked there."""

import functools
import json
import os
import re
import shlex
from itertools import chain
from pathlib import Path

from expertaug.config import jobs
from expertaug.config import recording_settings
from expertaug.config import report_parameters
from expertaug.evaluation import products
from expertaug.files import sha256
from expertaug.measurements.paths import read_checksums
from expertaug_recordings.intake import refusal
from expertaug_recordings.names import list_pictures
from expertaug.config.checks import PUBLISHED
from expertaug.source_files import PACKAGE
from expertaug.stages.files import LEARNING_SETS, Files
from expertaug.stages.planned import PRODUCTS, STUDIES, overviews, products_of, products_of_all
from expertaug.stages.planned import stages_read, studies, study_files
from expertaug.versions import MAIN_SETS, Version

FILES = Files(CONFIG)
results = FILES.path
SOURCE = CONFIG.recordings.source
# Given to the rules as a resource, not as a parameter: recordings that are sound need not be redone when it changes.
ON_BAD_RECORDING = CONFIG.recordings.on_bad_recording
# Cards that a job asks for: of a cluster, or of the one that profiles/default lets a run have (one job at a time on it).
GPUS = jobs.cards(CONFIG) if workflow.is_main_process else int(CONFIG.device == "cuda")
RUN = CONFIG.run
CALIBRATED = [e for e in RUN if CONFIG.experiments[e].data.calibrate]
RECORDED = [e for e in RUN if CONFIG.experiments[e].data.source == "recordings"]
SIMULATED = [e for e in RUN if CONFIG.experiments[e].data.source == "simulation"]
COMPARED = [e for e in RUN if CONFIG.experiments[e].evaluation.published is not None]
DRAWN = {product.name for _, product in PRODUCTS if product.figure}


def one_of(names):
    """A wildcard's constraint: one of these names, or nothing at all."""
    return "|".join(re.escape(name) for name in names) or "(?!)"


# What a rule asks of its stage. A stage is named as in STAGES, or by a function of the wildcards.


def stage_of(stage, wildcards):
    return STAGES[stage(wildcards) if callable(stage) else stage]


def modules_of(stage, wildcards):
    """Modules that the configuration names for a job of a stage that runs such."""
    if not stage.runs_methods:
        return ()
    method = wildcards.get("method") or (method_of(wildcards.variant) if "variant" in wildcards.keys() else None)
    return jobs.modules(CONFIG, wildcards.experiment, method)


def settings(stage, *names):
    """A parameter: a stage's slice of the configuration as JSON; what names the job are wildcards, or functions."""

    def text(wildcards):
        values = [name(wildcards) if callable(name) else wildcards[name] for name in names]
        return stage_of(stage, wildcards).settings_of(CONFIG, *values)

    return text


def software(stage):
    """A parameter: what computes a stage's numbers, that of the package and of the configuration's own classes, and of
    installed packages."""

    def digests(wildcards):
        of = stage_of(stage, wildcards)
        return of.software(modules_of(of, wildcards))

    return digests


def stage_params(stage, *names):
    """Parameters of a stage's jobs, of which each change redoes them: ``software`` and ``settings``."""
    return {"software": software(stage), "settings": settings(stage, *names)}


def command(stage, places, name=None):
    """A rule's shell: its stage with what the rule has for it, each by its place."""
    return STAGES[stage].command(places, name)


def folder(path):
    """A parameter: a folder of the results, named by the job's wildcards."""
    return lambda wildcards: results(path).format(**wildcards)


def option(name):
    """A parameter: the option of an input's name with its path; nothing where there is no such input."""
    return lambda wildcards, input: f"--{name} {shlex.quote(str(input[name]))}" if input[name] else ""


# What experiments have, and files that rules read.


def sets(experiment, names):
    return FILES.sets(experiment, names)


def of_versions(file, variants=FILES.compared):
    """An input: a file of every group of seeds of the experiment's versions that tables show, or of others."""
    return lambda wildcards: FILES.of_versions(wildcards.experiment, variants(wildcards.experiment), file)


def method_of(variant):
    return Version.parse(variant).method


def training_of(wildcards):
    """The stage that trains a method."""
    return CONFIG.methods[wildcards.method].estimator.stage


def base_model(wildcards):
    """The model file of a version's method."""
    return FILES.model(wildcards.experiment, method_of(wildcards.variant), wildcards.seed_group)


def trained_model(wildcards):
    """The model file that a version uses."""
    return FILES.model(wildcards.experiment, Version.parse(wildcards.variant).trained, wildcards.seed_group)


def calibration(wildcards):
    return FILES.calibration(wildcards.experiment)


def checksums(wildcards):
    """The file of checksums of measurements, if any."""
    return (
        CONFIG.experiments[wildcards.experiment].data.files.checksums or [] if wildcards.experiment in MEASURED else []
    )


def horizon_stage(wildcards):
    """The stage that cuts long chunks."""
    return "cut_measured_horizon" if wildcards.experiment in MEASURED else "cut_horizon"


def prior(wildcards):
    return FILES.prior(wildcards.experiment, wildcards.variant, wildcards.seed_group)


wildcard_constraints:
    recording=r"[^/]+",
    experiment=one_of(RUN),
    method=one_of(CONFIG.methods),
    variant=one_of([v for e in RUN for v in [*FILES.variants(e), *FILES.found_priors(e)]]),
    seed_group=one_of({group for e in RUN for group in jobs.seed_groups(CONFIG, e)}),
    set=r"\w+",
