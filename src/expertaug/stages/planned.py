"""Jobs that a configuration means: each a stage and the names that its slice of the configuration takes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from os.path import dirname
from pathlib import Path

from expertaug.config import jobs, report_parameters
from expertaug.config.models import Configuration
from expertaug.evaluation.products import OVERVIEWS, PLOTTED, Product
from expertaug.stages import STAGES
from expertaug.stages.files import Files
from expertaug.stages.study import StudyStage
from expertaug.versions import Version

# Every table and figure for readers, with the stage that makes it.
PRODUCTS = [(stage, product) for stage in STAGES.values() for product in stage.products()]
# Studies by name, each a stage.
STUDIES: dict[str, type[StudyStage]] = {p.name: stage for stage, p in PRODUCTS if issubclass(stage, StudyStage)}


def plan(config: Configuration) -> Iterator[tuple[str, tuple]]:
    """Every job of a completed configuration's run, but that jobs of recordings are without their names."""
    run = config.run
    sources = {config.experiments[name].data.source for name in run}
    yield "init_tracking", ()
    if "recordings" in sources:
        yield from _of_recordings(config)
    for name in run:
        yield from _of_experiment(config, name)
    published = [name for name in run if config.experiments[name].evaluation.published is not None]
    if published:
        yield "compare", (published,)
    if report_parameters.overview(config, run)["experiments"]:
        yield "overview", (run,)


def stages_read(config: Configuration) -> list[tuple[str, str]]:
    """Pairs of stages of a run: each with one that reads what it makes."""
    run = {stage for stage, _ in plan(config)}
    return sorted((source, stage) for stage in run for source in STAGES[stage].reads if source in run)


@cache
def studies(files: Files, experiment: str) -> tuple[str, ...]:
    """Names of the studies that an experiment has."""
    return tuple(name for name, stage in STUDIES.items() if stage.inputs(files, experiment, name))


def study_files(files: Files, experiment: str, names: Iterable[str]) -> list[str]:
    """Tables and figures of those studies that an experiment has, after everything that they are made from."""
    made: list[str] = []
    for name in studies(files, experiment):
        if name in names:
            read = STUDIES[name].inputs(files, experiment, name)
            made += [*files.to_files(experiment, read), *STUDIES[name].sets(files, experiment)]
            made += [files.path(file) for file in _find(name).files(experiment)]
    return made


def products_of(files: Files, experiment: str) -> list[str]:
    """All tables and figures of an experiment, tables first."""
    block = files.config.experiments[experiment]
    names = {"", *(product.name for product in PLOTTED), *studies(files, experiment)}
    names |= {"published"} if block.evaluation.published is not None else set()
    names |= {"splits"} if block.data.source == "recordings" else set()
    made = [
        file
        for _, product in PRODUCTS
        if product.name in names and not product.of_all
        for file in product.files(experiment)
    ]
    return [files.path(file) for file in sorted([f"tables/{experiment}_long.csv", *made], key=dirname, reverse=True)]


def products_of_all(files: Files) -> list[str]:
    """Tables and figures over all experiments of the run."""
    stages = {stage for stage, _ in plan(files.config)}
    shown = overviews(files.config)
    made = [
        product
        for stage, product in PRODUCTS
        if product.of_all and (product.name in shown if stage.key() == "overview" else stage.key() in stages)
    ]
    return [files.path(file) for product in made for file in product.files("")]


def list_kept(experiments: Iterable[str]) -> list[str]:
    """The tables and pictures of a run, in the results folder: figures as PNG alone."""
    named = list(experiments)
    long = [f"tables/{experiment}_long.csv" for experiment in named]
    of_each = [file for e in named for _, p in PRODUCTS if not p.of_all for file in p.files(e, ("png",))]
    return [*long, *of_each, *(file for _, p in PRODUCTS if p.of_all for file in p.files("", ("png",)))]


def overviews(config: Configuration) -> list[str]:
    """Names of the figures over all experiments."""
    experiments = report_parameters.overview(config, config.run)["experiments"]
    return [kind.name for kind in OVERVIEWS if any(block[kind.shows] for block in experiments)]


def _find(study: str) -> Product:
    return next(product for _, product in PRODUCTS if product.name == study)


def _of_recordings(config: Configuration) -> Iterator[tuple[str, tuple]]:
    source = config.recordings.source
    if source == "rendered":
        yield "render_video", ()
    if source != "markers":
        yield "extract_frames", (None,)
        yield "track_markers", (None,)
    else:
        if Path(config.recordings.markers.path or "").is_file():
            yield "unpack_markers", ()
        yield "import_markers", ()
    yield "measure_angles", (None,)
    yield "plot_recording", (None,)
    yield "summarise_recordings", ()


def _of_experiment(config: Configuration, experiment: str) -> Iterator[tuple[str, tuple]]:
    yield from _of_data(config, experiment)
    groups = list(jobs.seed_groups(config, experiment))
    for method in (*config.experiments[experiment].methods, *config.experiments[experiment].points):
        stage = config.methods[method].estimator.stage
        yield from ((stage, (experiment, method, group)) for group in groups)
    for version in jobs.list_found_priors(config, experiment):
        yield from (("own_prior", (experiment, version, group)) for group in (groups if version else [None]))
    for variant in [*jobs.variants(config, experiment), *jobs.further_variants(config, experiment)]:
        for stage in _of_version(Version.parse(variant)):
            yield from ((stage, (experiment, variant, group)) for group in groups)
    for method in Files(config).followed(experiment):
        yield from (("during_training", (experiment, method, group)) for group in groups)
    yield "log_evaluations", ()
    yield from ((stage, (experiment,)) for stage in ("tabulate", "plot"))
    yield from (
        (STUDIES[name].key(), STUDIES[name].names(experiment, name)) for name in studies(Files(config), experiment)
    )


def _of_data(config: Configuration, experiment: str) -> Iterator[tuple[str, tuple]]:
    data, horizons = config.experiments[experiment].data, config.experiments[experiment].data.horizons
    if data.source == "simulation":
        yield from (("simulate", (experiment, name)) for name in data.simulated)
    elif data.source == "files":
        yield "cut_measurements", (experiment,)
        yield from (("cut_measured_horizon", (experiment, name)) for name in horizons)
    else:
        yield "split_chunks", (experiment,)
        yield "plot_splits", ()
        yield from (("cut_horizon", (experiment, name)) for name in horizons)
    if data.calibrate:
        yield "calibrate", (experiment,)


def _of_version(version: Version) -> Iterator[str]:
    yield "evaluate"
    if not version.is_trained:
        return
    if version.is_flow:
        yield "flow"
    elif version.step:
        yield "finetune"
        if version.is_augmented:
            yield "augment"
