"""What no single block of a configuration says: names that exist, ranges that agree, files that do not collide."""

from __future__ import annotations

import csv
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypeAlias

from expertaug.config import jobs, options
from expertaug.config.layers import overridden
from expertaug.config.models import Common, Experiment, Method, Override
from expertaug.config.recording_settings import is_single
from expertaug.config.report_parameters import prior_of
from expertaug.config.sources import wrong_measurements
from expertaug.errors import InputError
from expertaug.evaluation.products import Product
from expertaug.learning.settings import SolverOnly, TrainSettings
from expertaug.models.estimators import EstimatorKind, Hybrid
from expertaug.systems.settings import EVENTS
from expertaug.versions import FLOW, Version, base
from expertaug.wording import is_multiple, number_in, other_parameters, suggest, unknown, unknown_keys, unknown_one
from expertaug_recordings.settings import RecordingKeys

# Folders beside those of the experiments in the results folder.
RESERVED = ("recordings", "tables", "figures", "mlflow", "published", "logs")
TARGETS = ("export", "recordings", "studies", "report", "all", "everything")  # beside the stages
FREE = ("label", "sha256", "results", "path", "rate_provenance", "experiment", "title", "set_titles", "uri")
PUBLISHED = Path(__file__).parents[1] / "evaluation" / "paper.csv"
BLOCKS = ("training", "finetuning", "refinement", "flow", "alternation", "evaluation")  # that name a solver
SOLVERS = ("solver", "draws_solver")


def check_texts(value: object, path: str = "") -> Iterator[InputError]:
    """Numbers that YAML took for texts, but in names and labels, and texts that no file or program takes."""
    if isinstance(value, str):
        if any(ord(c) < 32 and c not in "\n\t" for c in value):
            yield InputError(path, f"found {value!r}", "remove its control characters")
        number = number_in(value) if "e" in value.lower() else None
        if number and path.rpartition(".")[2] not in FREE:
            remedy = f"write {number}, or name it otherwise"
            yield InputError(path, f"found '{value}', which YAML takes for a text", remedy)
    elif isinstance(value, int) and not isinstance(value, bool):
        if abs(value) > 2**63:
            yield InputError(path, f"found a number of {len(str(abs(value)))} digits", "give a smaller one")
    elif isinstance(value, Mapping):
        for key, item in value.items():
            yield from check_texts(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list | tuple):
        for k, item in enumerate(value):
            yield from check_texts(item, f"{path}[{k}]")


def check_results(folder: str) -> Iterator[InputError]:
    """A results folder that cannot be written."""
    if folder.startswith("~"):
        yield InputError("results", f"found '{folder}'", "there is no such user: name the folder itself")
        return
    try:
        existing = next(path for path in (Path(folder), *Path(folder).absolute().parents) if path.exists())
    except (OSError, ValueError) as error:
        yield InputError("results", f"'{folder}' is no folder ({error})", "choose another results folder")
        return
    if not existing.is_dir():
        yield InputError("results", f"'{existing}' is no folder", "choose another results folder")
    elif not os.access(existing, os.W_OK | os.X_OK):
        yield InputError("results", f"'{existing}' cannot be written", "choose a writable results folder")


class MakesProducts(Protocol):
    """What is asked of a stage of the workflow."""

    @classmethod
    def products(cls) -> tuple[Product, ...]:
        """Its tables and figures."""
        ...


Stages: TypeAlias = Mapping[str, type[MakesProducts]]  # by name


def check_name(name: str, experiments: Collection[str], stages: Stages) -> Iterator[InputError]:
    """An experiment's name that files, rules (those of ``stages`` too) or other experiments need."""
    where = f"experiments.{name}"
    if name in RESERVED:
        yield InputError(where, "the results folder needs this name", "choose another name")
    if name in TARGETS or name in stages:
        yield InputError(where, "a stage of the workflow has this name", "choose another name")
    # Tables of an experiment are called after it and one of these.
    for ending in ("long", *(p.name for stage in stages.values() for p in stage.products() if p.table and p.name)):
        other = name.removesuffix(f"_{ending}")
        if other != name and other in experiments:
            yield InputError(where, f"the files of '{other}' would have the same names", "choose another name")


def check_experiment(where: str, experiment: Experiment, config: Common) -> Iterator[InputError]:
    """Everything that is wrong with a completed experiment.

    Arguments:
        experiment: with the keys of what it is based on, of the preset, and with defaults.
        config: its methods and recordings are read.
    """
    methods = config.methods
    missing = list(unknown(experiment.methods, methods, f"{where}.methods", "method"))
    missing += [e for m in experiment.overrides for e in unknown_one(m, methods, f"{where}.overrides.{m}", "method")]
    yield from missing
    if missing:
        return
    system, wrong = options.describe_system(experiment.system, f"{where}.system")
    yield from wrong
    own = []
    for part, settings in experiment.model.dump().items():
        own += options.check_part(part, settings, f"{where}.model.{part}", system, experiment.data.t1_s)
    yield from own
    yield from _objectives(where, experiment, methods)
    yield from _bounds(where, experiment)
    for method in [m for m in experiment.methods if m in experiment.overrides]:
        here, inherited = f"{where}.overrides.{method}", {str(error) for error in own}
        for error in _overridden(here, experiment, experiment.overrides[method], system, methods[method]):
            if str(error).replace(here, where, 1) not in inherited:
                yield error
    yield from _check_augmented(where, experiment, methods)
    yield from _versions(where, experiment, methods)
    yield from _fits(where, experiment, methods, system)
    if system is not None and system.events:
        yield from _events(where, experiment, methods, system.jumps)
    if experiment.data.source == "simulation":
        yield from _loss_ends(where, experiment)
        yield from _simulation(where, experiment, system)
    elif experiment.data.source == "files":
        yield from wrong_measurements(where, experiment, system)
    else:
        yield from _chunks(where, experiment, config.recordings)
    yield from _further_priors(where, experiment)
    yield from _studies(where, experiment, methods)
    yield from _evaluation(where, experiment)


def _objectives(where: str, experiment: Experiment, methods: dict[str, Method]) -> Iterator[InputError]:
    """Objectives of the methods, and options that belong to none of them."""
    kinds = {}
    for method in experiment.methods:
        if methods[method].estimator.has_objective:
            kind = methods[method].objective_kind
            kinds[kind] = None
            yield from options.find_objective(kind, f"methods.{method}.objective")[1]
    for block in ("training", "finetuning"):
        at = f"{where}.{block}.objective"
        for option, value in _options(getattr(experiment, block)).items() if kinds else ():
            takers = [k for k in kinds if options.takes_option(k, option)]
            # What this experiment is based on may have methods of other objectives.
            takers = takers or [k for k in options.OBJECTIVES if options.takes_option(k, option)]
            # Each method takes of these what is its own objective's; what none takes is said by the first of them.
            for kind in takers or list(kinds)[:1]:
                of_it = options.check_options(kind, {option: value}, at)
                yield from (e for e in of_it if e.where == f"{at}.{option}" or e.where.startswith(f"{at}.{option}["))


def _bounds(where: str, experiment: Experiment) -> Iterator[InputError]:
    """A bound of z_a before there is a model whose z_a could be it."""
    blocks = {f"{where}.training": experiment.training}
    blocks |= {f"{where}.overrides.{method}.training": over.training for method, over in experiment.overrides.items()}
    for at, training in blocks.items():
        if training is not None and training.bound_z_a:
            yield InputError(
                f"{at}.bound_z_a", "found true", "say it under finetuning: the trained model's z_a bound it"
            )


def _options(training: TrainSettings | None) -> dict[str, object]:
    """Options of the objective that a training names."""
    return (training.objective if training is not None else None) or {}


def _loss_ends(where: str, experiment: Experiment) -> Iterator[InputError]:
    """Ends of loss windows beyond the simulated trajectories."""
    end = experiment.data.t2_s
    for keys, owner in ((where, experiment), *((f"{where}.overrides.{m}", o) for m, o in experiment.overrides.items())):
        for name in ("training", "alternation", "finetuning"):
            horizon = getattr(getattr(owner, name), "horizon_s", None)
            if horizon is not None and horizon > end:
                yield InputError(f"{keys}.{name}.horizon_s", f"found {horizon:g}", f"the data end at {end:g} s")


def _overridden(
    where: str, experiment: Experiment, over: Override, system: options.KnownSystem | None, method: Method
) -> Iterator[InputError]:
    """What a method has otherwise, as it is together with what it keeps."""
    merged = overridden(experiment, over)
    if over.system is not None:
        system, wrong = options.describe_system(merged.system, f"{where}.system")
        yield from wrong
    for part in over.model.dump() if over.model is not None else ():
        if getattr(method, part, None) is not False:
            settings = getattr(merged.model, part)
            yield from options.check_part(part, settings, f"{where}.model.{part}", system, experiment.data.t1_s)
    if over.training is not None and not method.estimator.trains():
        for name in sorted(over.training.model_fields_set - set(SolverOnly.model_fields)):
            problem = f"a method of kind {method.kind} is not trained"
            yield InputError(f"{where}.training.{name}", problem, f"give it {', '.join(SolverOnly.model_fields)} alone")
    for block in ("training", "finetuning"):
        own = _options(getattr(over, block))
        if own and method.estimator.has_objective:
            yield from options.check_options(method.objective_kind, own, f"{where}.{block}.objective")


def _check_augmented(where: str, experiment: Experiment, methods: dict[str, Method]) -> Iterator[InputError]:
    yield from unknown(experiment.augmented, experiment.methods, f"{where}.augmented", "method of this experiment")
    for k, method in enumerate(experiment.augmented):
        if not _estimator(methods, method).has_objective:
            remedy = "only hybrid methods can be augmented"
            yield InputError(f"{where}.augmented[{k}]", f"'{method}' is of kind {methods[method].kind}", remedy)
    if experiment.augmented and experiment.finetuning is None:
        yield InputError(f"{where}.finetuning", "missing", "methods under augmented need it")


def _versions(where: str, experiment: Experiment, methods: dict[str, Method]) -> Iterator[InputError]:
    """The keys controls, flows and refined; versions of methods that the experiment does not train are no mistake: an
    override may take a method away."""
    blocks = {
        "controls": (experiment.controls, lambda kind: kind.has_objective, "only hybrid methods can be trained on"),
        "flows": (
            experiment.flows,
            lambda kind: kind.trains(),
            "only methods of kind hybrid and alternating have a posterior",
        ),
    }
    for block, (named, fits, remedy) in blocks.items():
        yield from unknown(named, methods, f"{where}.{block}", "method")
        for k, method in enumerate(named):
            if not fits(_estimator(methods, method)):
                problem = f"'{method}' is of kind {methods[method].kind}"
                yield InputError(f"{where}.{block}[{k}]", problem, remedy)
    for k, method in enumerate(experiment.flows):
        kind = _estimator(methods, method)
        knows = method in experiment.methods and kind.fits_windows and kind.shares
        if knows and _own(experiment, method).refinement.of_sensors:
            problem = f"'{method}' has constants of sensors, which a flow does not know"
            yield InputError(f"{where}.flows[{k}]", problem, "leave it out")
    if set(experiment.controls) & set(experiment.methods) and experiment.finetuning is None:
        yield InputError(f"{where}.finetuning", "missing", "methods under controls need it")
    for k, variant in enumerate(experiment.refined):
        here, kind = f"{where}.refined[{k}]", _estimator(methods, base(variant))
        yield from unknown_one(base(variant), methods, here, "method")
        if Version.parse(variant).estimators not in ((), (FLOW,)):
            yield InputError(here, f"found '{variant}'", "name the version that is to be refined, as METHOD+")
        elif variant in experiment.refined[:k]:
            yield InputError(here, f"'{variant}' is there twice", "name each version once")
        elif not kind.has_expert:
            problem = f"'{variant}' is of kind {methods[base(variant)].kind}"
            yield InputError(here, problem, "name a version with an expert")
        elif kind.fits_windows and FLOW not in Version.parse(variant).estimators:
            problem = f"'{variant}' is of kind {methods[base(variant)].kind}"
            yield InputError(here, problem, "it is fitted to each window already")


def _fits(
    where: str, experiment: Experiment, methods: dict[str, Method], system: options.KnownSystem | None
) -> Iterator[InputError]:
    """Least squares on each window."""
    for method in [m for m in experiment.methods if methods[m].estimator.fits_windows]:
        over = experiment.overrides.get(method)
        own = over.refinement if over is not None else None
        says = own is not None and "starts" in own.model_fields_set
        if not (own.starts if own is not None and says else experiment.refinement.starts):
            at = f"overrides.{method}.refinement.starts" if says else "refinement.starts"
            yield InputError(f"{where}.{at}", "found 0", f"{method} has no other starts: give 1 or more")
            break
    for k, method in enumerate(experiment.methods):
        if methods[method].truth and experiment.data.source != "simulation":
            problem = f"'{method}' takes the equation that made the data"
            yield InputError(f"{where}.methods[{k}]", problem, "only simulated data have one: leave it out")
    state = None if system is None else system.state
    yield from unknown_keys(experiment.data.start, state, f"{where}.data.start", "component of the state")
    yield from _check_shared(where, experiment, methods, system)


def _check_shared(
    where: str, experiment: Experiment, methods: dict[str, Method], system: options.KnownSystem | None
) -> Iterator[InputError]:
    """What windows share: parameters and components that there are, no first values, and something at least where a
    method shares."""
    started = jobs.starts(experiment)
    blocks = [(f"{where}.refinement", experiment.refinement, system)]
    for method, over in experiment.overrides.items():
        if over.refinement is not None:
            merged = overridden(experiment, over)
            seen = system if over.system is None else options.describe_system(merged.system, where)[0]
            blocks.append((f"{where}.overrides.{method}.refinement", over.refinement, seen))
    for at, block, seen in blocks:
        state, expert = (None, None) if seen is None else (seen.state, seen.expert)
        for name in ("windows", "sensors"):
            yield from unknown_keys(getattr(block, name) or {}, state, f"{at}.{name}", "component of the state")
        for name in ("units", "population"):
            yield from unknown_keys(getattr(block, name) or {}, expert, f"{at}.{name}", "expert parameter")
        for name in (*block.shared, *block.tied):
            if name in started:
                problem = "says how a window begins, and no two begin alike"
                yield InputError(f"{at}.units.{name}", problem, "leave it out")
        for name in block.population or {}:
            if name in block.shared:
                yield InputError(
                    f"{at}.population.{name}", "is shared by all windows", "leave it out here, or in units"
                )
    for k, method in enumerate(experiment.methods):
        kind, told = methods[method].estimator, _own(experiment, method).refinement
        if kind.shares and not (told.shares if kind.fits_windows else told.shared):
            problem = f"'{method}' fits what windows share, and nothing is said to be shared"
            first = next(iter((system.expert if system is not None else None) or ()), "NAME")
            yield InputError(f"{where}.methods[{k}]", problem, f"give refinement: {{units: {{{first}: shared}}}}")
    for k, variant in enumerate(experiment.refined):
        own = _own(experiment, base(variant))
        told = own.refinement
        if (told.shared or told.tied or told.population) and prior_of(own.augmentation) is None:
            problem = f"windows of '{variant}' share parameters, and nothing says where their fits start"
            yield InputError(f"{where}.refined[{k}]", problem, "give augmentation.prior")


def _own(experiment: Experiment, method: str) -> Experiment:
    """An experiment as it is for a method."""
    over = experiment.overrides.get(method)
    return experiment if over is None else overridden(experiment, over)


def _estimator(methods: dict[str, Method], method: str) -> type[EstimatorKind]:
    """What a method is; one that does not exist, of which something else complains, can do everything."""
    return methods[method].estimator if method in methods else Hybrid


def _events(where: str, experiment: Experiment, methods: dict[str, Method], jumps: bool) -> Iterator[InputError]:
    """What a system with events leaves no choice of: solvers that stop at them, and methods whose expert knows them.

    Arguments:
        jumps: whether what is observed jumps there.
    """
    blocks = {f"{where}.{block}": getattr(experiment, block) for block in BLOCKS}
    for method, over in experiment.overrides.items():
        blocks |= {f"{where}.overrides.{method}.{block}": getattr(over, block, None) for block in BLOCKS}
    for at, block in blocks.items():
        for key in SOLVERS:
            solver = getattr(block, key, None)
            if solver is not None and "method" in solver.model_fields_set and solver.method != EVENTS:
                problem = f"'{solver.method}' steps over the system's events"
                yield InputError(f"{at}.{key}.method", problem, f"give {EVENTS}, with substeps")
    for k, method in enumerate(experiment.methods):
        if methods[method].expert is False:
            problem = f"'{method}' has no expert, who alone knows the system's events"
            yield InputError(f"{where}.methods[{k}]", problem, "leave it out")
        elif jumps and methods[method].estimator.trains():
            problem = f"'{method}' is trained by gradients, and what the system observes jumps at its events"
            remedy = "take a method of kind least_squares, or observe what does not"
            yield InputError(f"{where}.methods[{k}]", problem, remedy)


def _simulation(where: str, experiment: Experiment, system: options.KnownSystem | None) -> Iterator[InputError]:
    sets = experiment.data.simulated
    first, name = next(iter(sets)), experiment.system["name"]
    if system is not None:
        yield from options.check_simulated(name, system, f"{where}.system.name")
        for part, names in (("z_e", system.expert), ("z_a", system.interaction)):
            if names is not None:
                at = f"{where}.data.sets.{first}.{part}"
                yield from _other(getattr(sets[first], part), names, at, f"the system {name}")
        for key, drawn in sets.items() if system.drawn is not None else ():
            if drawn.inputs is not None or system.drawn:
                at = f"{where}.data.sets.{key}.inputs"
                yield from _other(drawn.inputs or {}, system.drawn or (), at, f"the system {name}")
    if experiment.augmentation.prior is not None:
        yield from _other(
            experiment.augmentation.prior, sets[first].z_e, f"{where}.augmentation.prior", "the sets' z_e"
        )


def _other(ranges: Iterable[str], expected: Iterable[str], where: str, of: str) -> Iterator[InputError]:
    """Ranges that are not of the same parameters as those of something else."""
    complaint = other_parameters(ranges, expected, of)
    if complaint is not None:
        yield InputError(where, *complaint)


def _chunks(where: str, experiment: Experiment, recordings: RecordingKeys) -> Iterator[InputError]:
    single = is_single(recordings)
    other = {"pendulum": not single, "double_pendulum": single}.get(experiment.system["name"], False)
    if other or (single and experiment.data.calibrate):
        reason = "the recordings are of a single pendulum (tracking.markers.tip is null)" if single else "they are not"
        remedy = (
            "give the system pendulum, without calibrate" if single else "set recordings.tracking.markers.tip to null"
        )
        yield InputError(f"{where}.system.name", f"found {experiment.system['name']}; {reason}", remedy)
    split = experiment.data.split
    assert split.rate_hz is not None  # completed
    end = (split.length - 1) / split.rate_hz
    if experiment.data.t1_s > end:
        yield InputError(f"{where}.data.t1_s", f"found {experiment.data.t1_s:g}", f"a chunk ends at {end:g} s")
    key, rate = "markers.rate_hz" if recordings.source == "markers" else "analysis_rate_hz", analysed_hz(recordings)
    if not is_multiple(rate, split.rate_hz):
        remedy = f"recordings.{key}, {rate:g}, must be a multiple of it; null chooses one"
        yield InputError(f"{where}.data.split.rate_hz", f"found {split.rate_hz:g}", remedy)


def analysed_hz(recordings: RecordingKeys) -> float:
    """Frames per second of the recordings' angles."""
    return recordings.markers.rate_hz if recordings.source == "markers" else recordings.analysis_rate_hz


def _further_priors(where: str, experiment: Experiment) -> Iterator[InputError]:
    expected, of = experiment.augmentation.prior or {}, "augmentation.prior"
    set_names = experiment.data.set_names
    yield from unknown(experiment.augmentation.windows, set_names, f"{where}.augmentation.windows", "set")
    if experiment.data.simulated:
        expected, of = next(iter(experiment.data.simulated.values())).z_e, "the sets' z_e"
    for name, prior in experiment.further_priors.items():
        if not experiment.augmented:
            yield InputError(f"{where}.augmentations", "no method is under augmented", "name one there")
            return
        here = f"{where}.augmentations.{name}"
        yield from unknown(prior.methods or (), experiment.augmented, f"{here}.methods", "method under augmented")
        yield from unknown(prior.windows, set_names, f"{here}.windows", "set")
        if prior.prior is not None and expected:
            yield from _other(prior.prior, expected, f"{here}.prior", of)


def _studies(where: str, experiment: Experiment, methods: dict[str, Method]) -> Iterator[InputError]:
    shifted, here = experiment.studies.out_of_expertise, f"{where}.studies.out_of_expertise"
    if shifted is not None:
        set_names, what = experiment.data.set_names, "set of this experiment"
        for title, names in shifted.panels.items():
            yield from unknown(names, set_names, f"{here}.panels.{title}", what)
        if shifted.overview is not None:
            yield from unknown_one(shifted.overview, set_names, f"{here}.overview", what)
    study, here = experiment.studies.during_training, f"{where}.studies.during_training"
    if study is None:
        return
    wrong = list(unknown_one(study.method, experiment.methods, f"{here}.method", "method of this experiment"))
    yield from wrong
    if wrong:
        return
    kind = methods[study.method].kind
    if not methods[study.method].estimator.has_objective:
        remedy = "only hybrid methods can be augmented"
        yield InputError(f"{here}.method", f"'{study.method}' is of kind {kind}", remedy)
    if experiment.finetuning is None:
        yield InputError(f"{where}.finetuning", "missing", "studies.during_training needs it")
    over = experiment.overrides.get(study.method)
    training = (
        experiment.training if over is None or over.training is None else overridden(experiment.training, over.training)
    )
    for k, epoch in enumerate(study.epochs):
        if epoch > training.epochs:
            yield InputError(
                f"{here}.epochs[{k}]", f"found {epoch}", f"the training ends after {training.epochs} passes"
            )


def check_data_curves(experiments: Mapping[str, Experiment], run: Sequence[str]) -> Iterator[InputError]:
    """What is wrong with the studies of several experiments of a run."""
    for name in run:
        asked = experiments[name].studies.data_curves if name in experiments else None
        if asked is None:
            continue
        for along, points in asked.axes.items():
            where = f"experiments.{name}.studies.data_curves.{along}"
            wrong = list(unknown(points, run, where, "experiment of the run"))
            existing = [point for point in points if point in experiments]
            measured = [point for point in existing if experiments[point].data.source != "simulation"]
            wrong += [InputError(where, f"'{point}' is measured", "name simulated experiments") for point in measured]
            yield from wrong
            if wrong:
                continue
            taken: dict[float, str] = {}
            for point in existing:
                value = jobs.place_on(along, experiments[point])
                if (other := taken.setdefault(value, point)) != point:
                    yield InputError(where, f"'{other}' and '{point}' both have {value:g}", "name one of them")


def _evaluation(where: str, experiment: Experiment) -> Iterator[InputError]:
    set_names = experiment.data.set_names
    for name in experiment.evaluation.set_titles:
        if name not in set_names:
            yield InputError(f"{where}.evaluation.set_titles.{name}", "unknown key", suggest(name, set_names))
    if experiment.evaluation.published is not None:
        what = "system with published numbers"
        yield from unknown_one(
            experiment.evaluation.published, published_systems(), f"{where}.evaluation.published", what
        )


def published_systems() -> list[str]:
    """Systems whose published numbers this package knows."""
    with PUBLISHED.open(encoding="utf-8", newline="") as stream:
        return list(dict.fromkeys(row["system"] for row in csv.DictReader(stream)))
