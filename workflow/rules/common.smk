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
from expertaug.config import shown_settings
from expertaug.config import methods
from expertaug.evaluation import products
from expertaug.files import sha256
from expertaug.measurements.paths import read_checksums
from expertaug_recordings.intake import refusal
from expertaug_recordings.names import list_pictures
from expertaug.config.checks import PUBLISHED
from expertaug.source_files import PACKAGE
from expertaug.stages.files import LEARNING_SETS, Files
from expertaug.stages.planned import STUDIES, stages_read
from expertaug.stages.planned import studies as studies_planned
from expertaug.versions import MAIN_SETS, Version

<<<<<<< HEAD
NUMBERS = os.path.relpath(PUBLISHED)
PAGE = os.path.relpath(PACKAGE / "evaluation" / "report" / "page.html")
SOURCE = CONFIG.recordings.source
=======
FILES = Files(CONFIG)
results = FILES.path
SOURCE = CONFIG.recordings.source
>>>>>>> f583fe9 (Workflow: rules ask their stage for code, versions and settings; studies are rules of what products register)
# Given to the rules as a resource, not as a parameter: recordings that are sound need not be redone when it changes.
ON_BAD_RECORDING = CONFIG.recordings.on_bad_recording
# Cards that a job asks for: of a cluster, or of the one that profiles/default lets a run have (one job at a time on it).
<<<<<<< HEAD
GPUS = jobs.cards(CONFIG) if workflow.is_main_process else int(CONFIG.device == "cuda")
RUN = CONFIG.run
RECORDED = [e for e in RUN if CONFIG.experiments[e].data.source == "recordings"]
SIMULATED = [e for e in RUN if CONFIG.experiments[e].data.source == "simulation"]
RENDERED = ["video.mp4"] if SOURCE == "rendered" else []
LEARNING_SETS = ["train", "validation"]
FIGURES = [product.name for product in products.PLOTTED]
ENDS = [f".{end}" for end in products.TABLE_ENDS]
COMPARED = [e for e in RUN if CONFIG.experiments[e].evaluation.published is not None]
OVERVIEW = shown_settings.overview(CONFIG, RUN)["experiments"]
OVERVIEWS = ["log_mse", "parameter_errors"] if any(one["shown"] for one in OVERVIEW) else []
OVERVIEWS += ["za_shifted"] if any(one["shifted"] for one in OVERVIEW) else []
OVERVIEW_TITLES = {"log_mse": "log-MSE", "parameter_errors": "parameter errors", "za_shifted": "log-MSE, z_a shifted"}


def results(path):
    """A path in the results folder."""
    return f"{CONFIG.results}/{path}"
=======
GPUS = jobs.cards(CONFIG) if workflow.is_main_process else int(CONFIG.device == "cuda")
RUN = CONFIG.run
CALIBRATED = [e for e in RUN if CONFIG.experiments[e].data.calibrate]
RECORDED = [e for e in RUN if CONFIG.experiments[e].data.source == "recordings"]
SIMULATED = [e for e in RUN if CONFIG.experiments[e].data.source == "simulation"]
COMPARED = [e for e in RUN if CONFIG.experiments[e].evaluation.published is not None]
DRAWN = {one.name for one in products.PRODUCTS if one.figure}
>>>>>>> f583fe9 (Workflow: rules ask their stage for code, versions and settings; studies are rules of what products register)


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
    return methods.modules(CONFIG, wildcards.experiment, method)


def code(stage):
    """An input: the files of the package, and of the configuration's own classes, that a stage runs."""

    def files(wildcards):
        found = stage_of(stage, wildcards)
        return found.sources(modules_of(found, wildcards))

    return files


def settings(stage, *names):
    """A parameter: a stage's slice of the configuration as JSON; what names the job are wildcards, or functions."""

    def text(wildcards):
        values = [name(wildcards) if callable(name) else wildcards[name] for name in names]
        return stage_of(stage, wildcards).settings_of(CONFIG, *values)

    return text


def versions(stage):
    """A parameter: installed versions of the packages that compute a stage's numbers."""

    def names(wildcards):
        found = stage_of(stage, wildcards)
        return found.versions(modules_of(found, wildcards))

    return names


def stage_params(stage, *names):
    """Parameters of a stage's jobs, of which each change redoes them: ``versions`` and ``settings``."""
    return {"versions": versions(stage), "settings": settings(stage, *names)}


def option(name):
    """A parameter: the option of an input's name with its path; nothing where there is no such input."""
    return lambda wildcards, input: f"--{name} {shlex.quote(str(input[name]))}" if input[name] else ""


# What experiments have, and files that rules read.


<<<<<<< HEAD
def methods_of(experiment):
    return CONFIG.experiments[experiment].methods
=======
def sets(experiment, names):
    return FILES.sets(experiment, names)
>>>>>>> f583fe9 (Workflow: rules ask their stage for code, versions and settings; studies are rules of what products register)


def of_versions(file, variants=FILES.compared):
    """An input: a file of every group of seeds of the experiment's versions that tables show, or of others."""
    return lambda wildcards: FILES.of_versions(wildcards.experiment, variants(wildcards.experiment), file)


def method_of(variant):
    return Version.parse(variant).method


<<<<<<< HEAD
def trained_as(variant):
    """The version whose model file this one uses."""
    return str(Version.parse(variant).trained)


def per_seed_group(pattern, experiment, methods):
    """Files of every group of an experiment's methods; ``pattern`` has {method} and {seed_group}."""
    folder = results(f"{experiment}/{{method}}/{{seed_group}}/{pattern}")
    return expand(folder, method=methods, seed_group=seed_groups_of(experiment))


def trained_of(experiment):
    """Variants that have a training's log: all but those that are computed at once."""
    own = [v for v in jobs.variants(CONFIG, experiment) if Version.parse(v).is_trained]
    return [v for v in own if CONFIG.methods[method_of(v)].kind in ("alternating", "hybrid")]


def training_of(method):
    """The stage that trains a method."""
    return "alternate" if CONFIG.methods[method].kind == "alternating" else "train"
=======
def training_of(wildcards):
    """The stage that trains a method."""
    return "alternate" if CONFIG.methods[wildcards.method].kind == "alternating" else "train"
>>>>>>> f583fe9 (Workflow: rules ask their stage for code, versions and settings; studies are rules of what products register)


def base_model(wildcards):
    """The model file of a version's method."""
    return FILES.model(wildcards.experiment, method_of(wildcards.variant), wildcards.seed_group)


def trained_model(wildcards):
    """The model file that a version uses."""
    return FILES.model(wildcards.experiment, Version.parse(wildcards.variant).trained, wildcards.seed_group)


def calibration(wildcards):
    return FILES.calibration(wildcards.experiment)


<<<<<<< HEAD
def prior_option(input):
    """The option that tells a stage the ranges."""
    return f"--prior {shlex.quote(str(input.prior))}" if input.prior else ""


def found_priors_of(experiment):
    """Pairs of what is printed for a p⁺ that found its own ranges, and its file: before training, then of versions."""
    found, pairs = jobs.found_priors(CONFIG, experiment), []
    if "" in found:
        pairs.append((("before training", "all"), results(f"{experiment}/data/prior.json")))
    for variant in [v for v in found if v]:
        for group in seed_groups_of(experiment):
            name = (jobs.label(CONFIG, variant), group.removeprefix("seeds_").replace("_", ", "))
            pairs.append((name, results(f"{experiment}/{variant}/{group}/prior.json")))
    return pairs


def sets_to_cover(experiment, variant):
    """The training set, and those whose observed windows a p⁺ is to cover."""
    named = json.loads(settings("own_prior", experiment, variant, None))["windows"]
    return expand(results("{experiment}/data/{set}.npz"), experiment=experiment, set=["train", *named])


def sets_to_check(experiment):
    """Sets whose windows say whether F_a holds."""
    return ["train", "iid" if "iid" in sets_of(experiment) else "validation", "test"]


def kind_of(variant):
    return CONFIG.methods[method_of(variant)].kind


def studies_of(experiment):
    return jobs.studies(CONFIG, experiment)


def during_training_of(experiment):
    """Scores of the models along training."""
    study = CONFIG.experiments[experiment].studies.during_training
    return per_seed_group("during_training.csv", experiment, [study.method]) if study else []


def window_studies_of(experiment):
    """Studies of single windows: every experiment's alarms, and curves where the training range is known."""
    named = ["alarm", "coverage", "distance"] if experiment in SIMULATED else ["alarm", "coverage"]
    return [*named, "validity"] if jobs.checked(CONFIG, experiment) else named


def studied(experiment, study):
    """Files of metrics that a study reads."""
    if study == "during_training":
        return during_training_of(experiment)
    return per_seed_group("metrics.csv", experiment, jobs.studied(CONFIG, experiment, study))


def calibration_of(experiment):
    """The fitted constants of an experiment's expert, where it is to be calibrated."""
    return results(f"{experiment}/data/calibration.json") if CONFIG.experiments[experiment].data.calibrate else []


def recording_names():
    """Names of the recordings; of an archive they are known only when it is unpacked."""
    if RECORDINGS is not None:
        return list(RECORDINGS)
    from expertaug_recordings.ibm import list_marker_files

    return list(list_marker_files(checkpoints.unpack_markers.get().output.folder))


def video_of(name):
    """The video of a recording: the user's, or the rendered one."""
    return RECORDINGS[name] if SOURCE == "videos" else results(f"recordings/{name}/video.mp4")


def board_of(name):
    """The pictures of a checkerboard that tell a recording's lens, if any."""
    board = recording_settings.of_recording(CONFIG.recordings, name).angles.rectify.checkerboard
    if board is None:
        return []
    return [str(path) for path in list_pictures(Path(board))] if Path(board).is_dir() else [board]


def marker_csv(name):
    """The marker CSV of a recording in the user's folder or in the unpacked archive."""
    if RECORDINGS is not None:
        return RECORDINGS[name]
    from expertaug_recordings.ibm import list_marker_files

    return str(list_marker_files(checkpoints.unpack_markers.get().output.folder)[name])


def checksum_of(name):
    """The option that checks a recording's file, where its checksum is configured."""
    path = CONFIG.recordings.checksums
    if path is None:
        return ""
    file = os.path.basename(video_of(name) if SOURCE == "videos" else marker_csv(name))
    return f"--sha256 {read_checksums(path, 'recordings.checksums')[file]}"


def to_retry(name, file):
    """Whether a recording was left out before and may be so no longer: a changed parameter of its jobs, which redoes
    them, while those of sound recordings stay as they are whatever on_bad_recording says."""
    return ON_BAD_RECORDING == "stop" and refusal(results(f"recordings/{name}/{file}")) is not None


def of_recordings(file):
    """A file of every recording."""
    return [results(f"recordings/{name}/{file}") for name in recording_names()]


def of_all(file):
    """The same for a target, where there are recordings; those of an archive are known when it is unpacked."""
    return (lambda wildcards: of_recordings(file)) if RECORDED else []


def forecasts_to_draw():
    """Forecasts that overlays draw, by label: those that are there already."""
    found = recording_settings.overlaid(CONFIG)
    if found is None:
        return {}
    paths = {v: results(f"{found[0]}/{v}/{seed_groups_of(found[0])[0]}/forecasts.npz") for v in found[1]}
    return {jobs.label(CONFIG, v): path for v, path in paths.items() if os.path.exists(path)}


def tables_of(experiment):
    named = [f"_{name}" for name in [*studies_of(experiment), *window_studies_of(experiment)]]
    named += ["_own_priors"] * bool(found_priors_of(experiment))
    named += ["_published"] * (experiment in COMPARED) + ["_dissipation"] * bool(dissipating_of(experiment))
    of_others = [f"{name}{end}" for name in named for end in ENDS]
    return expand(results(f"tables/{experiment}{{end}}"), end=[*ENDS, "_long.csv", *of_others])


def figures_of(experiment):
    further = ["splits"] if experiment in RECORDED else []
    further += ["dissipation"] if dissipating_of(experiment) else []
    return expand(
        results(f"figures/{experiment}_{{name}}.{{suffix}}"),
        name=[*FIGURES, *further, *studies_of(experiment), *window_studies_of(experiment)],
        suffix=["png", "pdf"],
    )


def and_before(files):
    """Input of a target: files, or functions that give some, with every file on the way to them.

    Snakemake does not see that a file on the way is missing if what was made of it is there (its issue 1978), as after
    a job that was stopped while it was redone, or when somebody has deleted it.
    """

    def before(wildcards):
        found = {file: "temp" not in flags for file, _, flags, _ in way_to(files, wildcards)}
        return [file for file, kept in found.items() if kept]

    return [files, before]


def way_to(files, wildcards):
    """Every file on the way to files, or to functions that give some: itself, its rule, its flags and its inputs."""
    found, todo = set(), [files]
    while todo:
        file = todo.pop()
        if callable(file):
            todo.append(file(wildcards))
        elif not isinstance(file, str):
            todo += file
        elif file not in found and (made := made_by(file)):
            maker, flags = made
            found.add(file)
            inputs = inputs_of(maker, tuple(maker.get_wildcards(file).items()), type(wildcards))
            todo += inputs
            yield file, maker, flags, inputs
=======
def prior(wildcards):
    return FILES.prior(wildcards.experiment, wildcards.variant, wildcards.seed_group)
>>>>>>> f583fe9 (Workflow: rules ask their stage for code, versions and settings; studies are rules of what products register)


@functools.cache
def studies_of(experiment):
    """Names of the studies that an experiment has."""
    return studies_planned(CONFIG, experiment)


# Tables and figures, and what the report shows of them.

SHOWN = []  # path, caption and title of each


def shown(path, caption, title, category, subcategory=None, **labels):
    """An output that reports show under a caption."""
    SHOWN.append((path, caption, title))
    options = {"category": category, "subcategory": subcategory, "labels": labels or {"content": title}}
    return report(path, caption=f"../report/{caption}.rst", **options)


def table(stem, caption, title, category, **labels):
    """The files of a table."""
    files = [results(f"tables/{stem}.{end}") for end in ("csv", "tex", "md")]
    return [*files[:2], shown(files[2], caption, title, category, **labels)]


<<<<<<< HEAD
def shown_in_report(files):
    """Of these files those that a rule marks for reports, as the stage report takes them; captions are theirs."""
    found = []
    for file in files:
        maker, flags = made_by(file)
        if "report" in flags:
            marked, wildcards = flags["report"], maker.get_wildcards(file)
            named = {key: text.format(**wildcards) for key, text in marked.labels.items()}
            found.append(
                {
                    "path": os.path.relpath(file, CONFIG.results),
                    "caption": os.path.relpath(marked.caption.get_path_or_uri(secret_free=True)),
                    "wildcards": dict(wildcards),
                    "title": named.get("study", "").replace("_", " ") or named.get("content") or named["experiment"],
                }
            )
    return found


SUMMARY = [results("recordings/summary.csv"), results("recordings/summary.md")] if RECORDED else []
OVERALL = expand(results("tables/published{end}"), end=ENDS) if COMPARED else []
OVERALL += expand(results("figures/{name}.{suffix}"), name=OVERVIEWS, suffix=["png", "pdf"])
EVALUATED = [results(f"{e}/evaluations.json") for e in RUN]
MADE = [OVERALL, [[tables_of(e), figures_of(e)] for e in RUN], SUMMARY, of_all("page.png")]
REPORT = results("report.html")
ALL = [MADE, EVALUATED, REPORT]
AUGMENTED = one_of([v for e in RUN for v in augmented_of(e)])
FINETUNED = one_of([v for e in RUN for v in finetuned_of(e)])
FLOWS = one_of([v for e in RUN for v in flows_of(e)])
FOUND_PRIORS = one_of([v for e in RUN for v in jobs.found_priors(CONFIG, e) if v])
=======
def figure(stem, caption, title, category, **labels):
    """The files of a figure."""
    picture = shown(results(f"figures/{stem}.png"), caption, title, category, **labels)
    return [picture, results(f"figures/{stem}.pdf")]
>>>>>>> f583fe9 (Workflow: rules ask their stage for code, versions and settings; studies are rules of what products register)


wildcard_constraints:
    recording=r"[^/]+",
    experiment=one_of(RUN),
<<<<<<< HEAD
    method=one_of(CONFIG.methods),
    variant=one_of([v for e in RUN for v in [*every_variant(e), *filter(None, jobs.found_priors(CONFIG, e))]]),
    study=one_of({name for e in RUN for name in studies_of(e)} - {"grid"}),
    seed_group=one_of({group for e in RUN for group in seed_groups_of(e)}),
=======
    method=one_of(CONFIG.methods),
    variant=one_of([v for e in RUN for v in [*FILES.variants(e), *FILES.found_priors(e)]]),
    seed_group=one_of({group for e in RUN for group in jobs.seed_groups(CONFIG, e)}),
>>>>>>> f583fe9 (Workflow: rules ask their stage for code, versions and settings; studies are rules of what products register)
    set=r"\w+",
