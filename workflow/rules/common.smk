"""Helpers of the rules; what is in the configuration and the package is asked there."""

import json
import os
import re
import shlex

from expertaug import slices
from expertaug.sources import sources

CONSTRAINTS = os.path.relpath(HERE.parent / "constraints.txt")
SOURCE = CONFIG["recordings"]["source"]
RUN = CONFIG["run"]
RECORDED = [e for e in RUN if CONFIG["experiments"][e]["data"]["source"] == "recordings"]
SIMULATED = [e for e in RUN if e not in RECORDED]
BLOCKS = list(slices.blocks(CONFIG))
FIGURES = ["log_mse", "parameter_errors", "parameters", "forecasts", "curves"]
EVALUATED_SETS = ["train", "validation", "test"]


def results(path):
    """A path in the results folder."""
    return f"{CONFIG['results']}/{path}"


def one_of(names):
    """A wildcard's constraint: one of these names, or nothing at all."""
    return "|".join(re.escape(name) for name in names) or "(?!)"


def settings(stage, *names):
    """A stage's slice of the configuration as JSON."""
    return json.dumps(getattr(slices, stage)(CONFIG, *names), sort_keys=True)


def code(stage, experiment=None, method=None):
    """The package's files that a stage runs, with those that the experiment's configuration names."""
    return sources(stage, slices.modules(CONFIG, experiment, method) if experiment else ())


def sets_of(experiment):
    return CONFIG["experiments"][experiment]["data"].get("sets", EVALUATED_SETS)


def methods_of(experiment):
    return CONFIG["experiments"][experiment]["methods"]


def augmented_of(experiment):
    return CONFIG["experiments"][experiment]["augmented"]


def per_block(pattern, experiment, methods):
    """Files of every block of an experiment's methods; ``pattern`` has {method} and {block}."""
    folder = results(f"{experiment}/{{method}}/{{block}}/{pattern}")
    return expand(folder, method=methods, block=BLOCKS)


def trained_of(experiment):
    """Variants that have a training's log: all but those that are computed at once."""
    return [v for v in slices.variants(CONFIG, experiment) if CONFIG["methods"][v.removesuffix("+")]["kind"] != "mean"]


def calibration_of(experiment):
    """The fitted constants of an experiment's expert, where it is to be calibrated."""
    return (
        results(f"{experiment}/data/calibration.json") if CONFIG["experiments"][experiment]["data"]["calibrate"] else []
    )


def recording_names():
    """Names of the recordings; of an archive they are known only when it is unpacked."""
    if RECORDINGS is not None:
        return list(RECORDINGS)
    from expertaug.recordings.archive import list_marker_files

    return list(list_marker_files(checkpoints.unpack_markers.get().output.folder))


def video_of(name):
    """The video of a recording: the user's, or the rendered one."""
    return RECORDINGS[name] if SOURCE == "videos" else results(f"recordings/{name}/video.mp4")


def marker_csv(name):
    """The marker CSV of a recording in the user's folder or in the unpacked archive."""
    if RECORDINGS is not None:
        return RECORDINGS[name]
    from expertaug.recordings.archive import list_marker_files

    return str(list_marker_files(checkpoints.unpack_markers.get().output.folder)[name])


def of_recordings(file):
    """A file of every recording."""
    return [results(f"recordings/{name}/{file}") for name in recording_names()]


def tables_of(experiment):
    return expand(results(f"tables/{experiment}{{end}}"), end=[".csv", "_long.csv", ".tex", ".md"])


def figures_of(experiment):
    splits = ["splits"] if experiment in RECORDED else []
    return expand(
        results(f"figures/{experiment}_{{name}}.{{suffix}}"),
        name=[*FIGURES, *splits],
        suffix=["png", "pdf"],
    )


SUMMARY = [results("recordings/summary.csv"), results("recordings/summary.md")] if RECORDED else []
REPORTED = [path for experiment in RUN for path in (*tables_of(experiment), *figures_of(experiment))]
ALL = [*SUMMARY, *REPORTED]


wildcard_constraints:
    recording=r"[^/]+",
    experiment=one_of(RUN),
    method=one_of(CONFIG["methods"]),
    variant=one_of([v for e in RUN for v in slices.variants(CONFIG, e)]),
    block=one_of(BLOCKS),
    set=r"\w+",
