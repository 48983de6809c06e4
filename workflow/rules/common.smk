"""Helpers of the rules; what is in the configuration and the package is asked there."""

import json
import os
import re
import shlex

from expertaug import labels
from expertaug.config import jobs
from expertaug.config import stage_settings
from expertaug.files import sha256
from expertaug.recordings.intake import refusal
from expertaug.config.stage_code import sources
from expertaug.config.study_checks import PUBLISHED
from expertaug.labels import MAIN_SETS

CONSTRAINTS = os.path.relpath(HERE.parent / "constraints.txt")
NUMBERS = os.path.relpath(PUBLISHED)
SOURCE = CONFIG["recordings"]["source"]
# Given to the rules as a resource, not as a parameter: recordings that are sound need not be redone when it changes.
ON_BAD_RECORDING = CONFIG["recordings"]["on_bad_recording"]
RUN = CONFIG["run"]
RECORDED = [e for e in RUN if CONFIG["experiments"][e]["data"]["source"] == "recordings"]
SIMULATED = [e for e in RUN if e not in RECORDED]
RENDERED = ["video.mp4"] if SOURCE == "rendered" else []
LEARNING_SETS = ["train", "validation"]
FIGURES = ["log_mse", "parameter_errors", "parameters", "forecasts", "curves"]
ENDS = [".csv", ".md", ".tex"]
COMPARED = [e for e in RUN if CONFIG["experiments"][e]["evaluation"]["published"] is not None]
OVERVIEW = stage_settings.overview(CONFIG, RUN)["experiments"]
OVERVIEWS = ["log_mse", "parameter_errors"] if any(one["shown"] for one in OVERVIEW) else []
OVERVIEWS += ["za_shifted"] if any(one["shifted"] for one in OVERVIEW) else []


def results(path):
    """A path in the results folder."""
    return f"{CONFIG['results']}/{path}"


def one_of(names):
    """A wildcard's constraint: one of these names, or nothing at all."""
    return "|".join(re.escape(name) for name in names) or "(?!)"


def settings(stage, *names):
    """A stage's slice of the configuration as JSON."""
    return json.dumps(getattr(stage_settings, stage)(CONFIG, *names), sort_keys=True)


def code(stage, experiment=None, method=None):
    """The package's files that a stage runs, with those that the experiment's configuration names."""
    return sources(stage, stage_settings.modules(CONFIG, experiment, method) if experiment else ())


def sets_of(experiment):
    return jobs.sets(CONFIG, experiment)


def methods_of(experiment):
    return CONFIG["experiments"][experiment]["methods"]


def every_variant(experiment):
    return [*jobs.variants(CONFIG, experiment), *jobs.further_variants(CONFIG, experiment)]


def augmented_of(experiment):
    return [v for v in every_variant(experiment) if v not in methods_of(experiment)]


def seed_groups_of(experiment):
    return list(jobs.seed_groups(CONFIG, experiment))


def method_of(variant):
    return labels.split(variant)[0]


def per_seed_group(pattern, experiment, methods):
    """Files of every group of an experiment's methods; ``pattern`` has {method} and {seed_group}."""
    folder = results(f"{experiment}/{{method}}/{{seed_group}}/{pattern}")
    return expand(folder, method=methods, seed_group=seed_groups_of(experiment))


def trained_of(experiment):
    """Variants that have a training's log: all but those that are computed at once."""
    return [v for v in jobs.variants(CONFIG, experiment) if CONFIG["methods"][method_of(v)]["kind"] != "mean"]


def studies_of(experiment):
    return jobs.studies(CONFIG, experiment)


def during_training_of(experiment):
    """Scores of the models along training."""
    study = CONFIG["experiments"][experiment]["studies"].get("during_training")
    return per_seed_group("during_training.csv", experiment, [study["method"]]) if study else []


def studied(experiment, study):
    """Files of metrics that a study reads."""
    if study == "during_training":
        return during_training_of(experiment)
    return per_seed_group("metrics.csv", experiment, jobs.studied(CONFIG, experiment, study))


def calibration_of(experiment):
    """The fitted constants of an experiment's expert, where it is to be calibrated."""
    return (
        results(f"{experiment}/data/calibration.json") if CONFIG["experiments"][experiment]["data"]["calibrate"] else []
    )


def recording_names():
    """Names of the recordings; of an archive they are known only when it is unpacked."""
    if RECORDINGS is not None:
        return list(RECORDINGS)
    from expertaug.recordings.imports.ibm import list_marker_files

    return list(list_marker_files(checkpoints.unpack_markers.get().output.folder))


def video_of(name):
    """The video of a recording: the user's, or the rendered one."""
    return RECORDINGS[name] if SOURCE == "videos" else results(f"recordings/{name}/video.mp4")


def marker_csv(name):
    """The marker CSV of a recording in the user's folder or in the unpacked archive."""
    if RECORDINGS is not None:
        return RECORDINGS[name]
    from expertaug.recordings.imports.ibm import list_marker_files

    return str(list_marker_files(checkpoints.unpack_markers.get().output.folder)[name])


def checksum_of(name):
    """The option that checks a recording's file, where its checksum is configured."""
    path = CONFIG["recordings"]["checksums"]
    if path is None:
        return ""
    file = os.path.basename(video_of(name) if SOURCE == "videos" else marker_csv(name))
    return f"--sha256 {recording_checks.read_checksums(path)[file]}"


def to_retry(name, file):
    """Whether a recording was left out before and may be so no longer: a changed parameter of its jobs, which redoes
    them, while those of sound recordings stay as they are whatever on_bad_recording says."""
    return ON_BAD_RECORDING == "stop" and refusal(results(f"recordings/{name}/{file}")) is not None


def of_recordings(file):
    """A file of every recording."""
    return [results(f"recordings/{name}/{file}") for name in recording_names()]


def pages(wildcards):
    """The page of every recording."""
    return of_recordings("page.png")


def forecasts_to_draw():
    """Forecasts that overlays draw, by label: those that are there already."""
    found = stage_settings.overlaid(CONFIG)
    if found is None:
        return {}
    paths = {v: results(f"{found[0]}/{v}/{seed_groups_of(found[0])[0]}/forecasts.npz") for v in found[1]}
    return {stage_settings.label(CONFIG, v): path for v, path in paths.items() if os.path.exists(path)}


def tables_of(experiment):
    named = [f"_{name}" for name in studies_of(experiment)] + ["_published"] * (experiment in COMPARED)
    of_others = [f"{name}{end}" for name in named for end in ENDS]
    return expand(results(f"tables/{experiment}{{end}}"), end=[*ENDS, "_long.csv", *of_others])


def figures_of(experiment):
    splits = ["splits"] if experiment in RECORDED else []
    return expand(
        results(f"figures/{experiment}_{{name}}.{{suffix}}"),
        name=[*FIGURES, *splits, *studies_of(experiment)],
        suffix=["png", "pdf"],
    )


# Targets name every file on the way to theirs: Snakemake does not see that one is missing if what was made of it is there
# (its issue 1978), as after a job that was stopped while it was redone.


def tracks(wildcards):
    """Markers of every recording, with its video where that is made."""
    return [path for file in (*RENDERED, "markers.csv") for path in of_recordings(file)]


def measurements(wildcards):
    """Angles of every recording with the files on the way to them."""
    return [*tracks(wildcards), *of_recordings("angles.csv")]


def data_of(experiment, sets):
    """Sets of an experiment and what its expert is fitted to, with the files on the way to them."""
    found = expand(results(f"{experiment}/data/{{set}}.npz"), set=sets)
    return [measurements, *found, calibration_of(experiment)] if experiment in RECORDED else found


def models_of(experiment, variants, sets=LEARNING_SETS):
    """Models of these variants with the files on the way to them."""
    tuned = [v for v in variants if v not in methods_of(experiment)]
    return [
        *data_of(experiment, sets),
        *per_seed_group("augmented.safetensors", experiment, tuned),
        *per_seed_group("model.safetensors", experiment, dict.fromkeys([*map(method_of, variants), *tuned])),
    ]


def metrics_of(experiment, variants):
    """Metrics of these variants with the files on the way to them."""
    return [
        *models_of(experiment, variants, sets_of(experiment)),
        *per_seed_group("metrics.csv", experiment, variants),
    ]


def scores_of(experiment, study):
    """What a study reads with the files on the way to it."""
    if study != "during_training":
        return metrics_of(experiment, jobs.studied(CONFIG, experiment, study))
    method = CONFIG["experiments"][experiment]["studies"][study]["method"]
    models = models_of(experiment, [method], MAIN_SETS)
    return [*models, *per_seed_group("snapshots.safetensors", experiment, [method]), *during_training_of(experiment)]


def everything_of(experiment):
    """Tables and figures of an experiment with the files on the way to them."""
    return [
        *metrics_of(experiment, every_variant(experiment)),
        *[path for study in studies_of(experiment) for path in scores_of(experiment, study)],
        *tables_of(experiment),
        *figures_of(experiment),
    ]


SUMMARY = [results("recordings/summary.csv"), results("recordings/summary.md")] if RECORDED else []
OVERALL = expand(results("tables/published{end}"), end=ENDS) if COMPARED else []
OVERALL += expand(results("figures/{name}.{suffix}"), name=OVERVIEWS, suffix=["png", "pdf"])
ALL = [*SUMMARY, *([measurements, pages] if RECORDED else []), *map(everything_of, RUN), *OVERALL]


# Trainings whose states at several stages are kept for the study along training, and the others; the condition is on
# two wildcards, so that the one looks ahead to the other.
_FOLLOWED = one_of(f"{e}/{m}/" for e in RUN for m in methods_of(e) if jobs.snapshots(CONFIG, e, m))
FOLLOWED = {"yes": rf"(?={_FOLLOWED})(?:{one_of(RUN)})", "no": rf"(?!{_FOLLOWED})(?:{one_of(RUN)})"}
AUGMENTED = one_of([v for e in RUN for v in augmented_of(e)])


wildcard_constraints:
    recording=r"[^/]+",
    experiment=one_of(RUN),
    method=one_of(CONFIG["methods"]),
    variant=one_of([v for e in RUN for v in every_variant(e)]),
    study=one_of({name for e in RUN for name in studies_of(e)}),
    seed_group=one_of({group for e in RUN for group in seed_groups_of(e)}),
    set=r"\w+",
