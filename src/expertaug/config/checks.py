"""What no single key says about a configuration: names that exist, ranges that agree, files that do not collide."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from expertaug.config import event_checks, inference_checks, measurement_checks, options, study_checks
from expertaug.config.layers import merge
from expertaug.config.names import other_parameters, unknown, unknown_one
from expertaug.errors import InputError
from expertaug.evaluation.products import PRODUCTS
from expertaug.wording import number_in, show

# Folders beside those of the experiments in the results folder.
RESERVED = ("recordings", "tables", "figures", "mlflow", "published", "logs", "benchmarks")
TARGETS = ("export", "recordings", "studies", "report", "all", "everything")  # beside the stages
# Tables of an experiment are called after it and one of these.
ENDINGS = ("long", *(one.name for one in PRODUCTS if one.table and one.name))
FREE = ("label", "sha256", "results", "path", "rate_provenance", "experiment", "title", "set_titles", "uri")


def texts(value: object, path: str = "") -> Iterator[InputError]:
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
            yield from texts(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list | tuple):
        for k, item in enumerate(value):
            yield from texts(item, f"{path}[{k}]")


def results(folder: str) -> Iterator[InputError]:
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


def seeds(found: list[int], where: str) -> Iterator[InputError]:
    """Seeds that are there twice."""
    for k, seed in enumerate(found):
        if seed in found[:k]:
            yield InputError(f"{where}[{k}]", f"{seed} is there twice", "give each seed once")


def name(experiment: str, experiments: Mapping, stages: Collection[str] = ()) -> Iterator[InputError]:
    """An experiment's name that files, rules (those of ``stages`` too) or other experiments need."""
    where = f"experiments.{experiment}"
    if experiment in RESERVED:
        yield InputError(where, "the results folder needs this name", "choose another name")
    if experiment in TARGETS or experiment in stages:
        yield InputError(where, "a stage of the workflow has this name", "choose another name")
    for ending in ENDINGS:
        other = experiment.removesuffix(f"_{ending}")
        if other != experiment and other in experiments:
            yield InputError(where, f"the files of '{other}' would have the same names", "choose another name")


def experiment(where: str, one: Mapping, config: Mapping) -> Iterator[InputError]:
    """Everything that is wrong with a completed experiment.

    Arguments:
        one: with the keys of what it is based on, of the preset, and with defaults.
        config: the whole configuration; its methods and recordings are read.
    """
    methods = config["methods"]
    yield from seeds(one.get("seeds", []), f"{where}.seeds")
    missing = list(unknown(one["methods"], methods, f"{where}.methods", "method"))
    missing += [e for m in one["overrides"] for e in unknown_one(m, methods, f"{where}.overrides.{m}", "method")]
    yield from missing
    if missing:
        return
    known, wrong = options.system(one["system"], f"{where}.system")
    yield from wrong
    own = []
    for part in ("encoder", "interaction"):
        own += options.part(part, one["model"][part], f"{where}.model.{part}", known, one["data"]["t1_s"])
    yield from own
    yield from _objectives(where, one, methods)
    for method in [m for m in one["methods"] if m in one["overrides"]]:
        over = one["overrides"][method]
        here, inherited = f"{where}.overrides.{method}", {str(error) for error in own}
        for error in _overridden(here, one, over, known, methods[method]):
            if str(error).replace(here, where, 1) not in inherited:
                yield error
    yield from unknown(one["augmented"], one["methods"], f"{where}.augmented", "method of this experiment")
    for k, method in enumerate(one["augmented"]):
        kind = methods.get(method, {}).get("kind", "hybrid")
        if kind != "hybrid":
            remedy = "only hybrid methods can be augmented"
            yield InputError(f"{where}.augmented[{k}]", f"'{method}' is of kind {kind}", remedy)
    yield from inference_checks.check(where, one, methods, known)
    if known is not None and known.events:
        yield from event_checks.check(where, one, methods, known.jumps)
    if one["augmented"] and "finetuning" not in one:
        yield InputError(f"{where}.finetuning", "missing", "methods under augmented need it")
    if one["data"]["source"] == "simulation":
        yield from _simulation(where, one, known)
    elif one["data"]["source"] == "files":
        yield from measurement_checks.check(where, one, known)
    else:
        yield from _chunks(where, one, config["recordings"])
    yield from study_checks.check(where, one, methods)


def _objectives(where: str, one: Mapping, methods: Mapping) -> Iterator[InputError]:
    """Objectives of the methods, and options that belong to none of them."""
    kinds = {}
    for method in one["methods"]:
        if methods[method]["kind"] != "hybrid":
            continue
        kind = methods[method].get("objective", "aphynity")
        kinds[kind] = None
        yield from options.objective(kind, f"methods.{method}.objective")[1]
    for block in ("training", "finetuning"):
        given = one.get(block, {}).get("objective", {})
        at = f"{where}.{block}.objective"
        for option, value in given.items() if kinds else ():
            takers = [k for k in kinds if options.takes_option(k, option)]
            # What this experiment is based on may have methods of other objectives.
            takers = takers or [k for k in options.OBJECTIVES if options.takes_option(k, option)]
            # Each method takes of these what is its own objective's; what none takes is said by the first of them.
            for kind in takers or list(kinds)[:1]:
                of_it = options.of_objective(kind, {option: value}, at)
                yield from (e for e in of_it if e.where == f"{at}.{option}" or e.where.startswith(f"{at}.{option}["))


def _overridden(
    where: str, one: Mapping, over: Mapping, known: options.KnownSystem | None, build: Mapping
) -> Iterator[InputError]:
    """What a method has otherwise, as it is together with what it keeps."""
    merged = merge(one, over)
    if "system" in over:
        known, wrong = options.system(merged["system"], f"{where}.system")
        yield from wrong
    for part in over.get("model", {}):
        if part not in ("encoder", "interaction"):
            yield from unknown([part], ("encoder", "interaction"), f"{where}.model", "part of a model")
            continue
        if build.get(part) is not False:
            yield from options.part(part, merged["model"][part], f"{where}.model.{part}", known, one["data"]["t1_s"])
    for block in ("training", "finetuning"):
        given = over.get(block, {}).get("objective", {})
        if given and build["kind"] == "hybrid":
            kind = build.get("objective", "aphynity")
            yield from options.of_objective(kind, given, f"{where}.{block}.objective")


def _simulation(where: str, one: Mapping, known: options.KnownSystem | None) -> Iterator[InputError]:
    data = one["data"]
    needed = {
        "step_s": "time from point to point in s",
        "t2_s": "end of a trajectory in s",
        "sets": "the simulated sets",
    }
    missing = [key for key in needed if key not in data]
    yield from (InputError(f"{where}.data.{key}", "missing", f"give {key} ({needed[key]})") for key in missing)
    sets = data.get("sets", {})
    lacking = [s for s in study_checks.MAIN_SETS if s not in sets] if "sets" in data else []
    yield from (InputError(f"{where}.data.sets.{s}", "missing", f"give {s}") for s in lacking)
    if missing or lacking:
        return
    if data["t1_s"] >= data["t2_s"]:
        found = f"found {data['t1_s']:g}, t2_s is {data['t2_s']:g}"
        yield InputError(f"{where}.data.t1_s", found, "t1_s must be less than t2_s")
    for key in ("t1_s", "t2_s"):
        if not is_multiple(data[key], data["step_s"]):
            remedy = f"give a multiple of step_s, {data['step_s']:g}"
            yield InputError(f"{where}.data.{key}", f"found {data[key]:g}", remedy)
    if not isinstance(data["noise"], int | float):
        yield InputError(f"{where}.data.noise", f"found {show(data['noise'])}", "give simulated sets one number")
    first, name = next(iter(sets)), one["system"]["name"]
    if known is not None:
        yield from options.simulated(name, known, f"{where}.system.name")
        for part, names in (("z_e", known.expert), ("z_a", known.interaction)):
            if names is not None:
                at = f"{where}.data.sets.{first}.{part}"
                yield from other_parameters(sets[first][part], names, at, f"the system {name}")
        yield from _inputs(f"{where}.data.sets", sets, known, name)
    for key, one_set in sets.items():
        for part in ("z_e", "z_a"):
            at = f"{where}.data.sets.{key}.{part}"
            yield from other_parameters(one_set[part], sets[first][part], at, f"the set {first}")
    if "iid" in sets and any(sets["iid"][part] != sets["validation"][part] for part in ("z_e", "z_a")):
        remedy = "give those of validation: it is drawn alike, and nothing is chosen on it"
        yield InputError(f"{where}.data.sets.iid", "other ranges than validation's", remedy)
    if (prior := one["augmentation"]["prior"]) is not None:
        yield from other_parameters(prior, sets[first]["z_e"], f"{where}.augmentation.prior", "the sets' z_e")


def _inputs(where: str, sets: Mapping, known: options.KnownSystem, name: str) -> Iterator[InputError]:
    """Ranges of what simulated inputs are drawn from, which may differ from set to set."""
    if known.drawn is None:
        return
    for key, one_set in sets.items():
        if "inputs" in one_set or known.drawn:
            yield from other_parameters(
                one_set.get("inputs", {}), known.drawn, f"{where}.{key}.inputs", f"the system {name}"
            )


def _chunks(where: str, one: Mapping, recordings: Mapping) -> Iterator[InputError]:
    if "split" not in one["data"]:
        remedy = "give split (chunks of the recordings and their division into sets)"
        yield InputError(f"{where}.data.split", "missing", remedy)
        return
    single = recordings["source"] == "videos" and recordings["tracking"]["markers"]["tip"] is None
    other = {"pendulum": not single, "double_pendulum": single}.get(one["system"]["name"], False)
    if other or (single and one["data"]["calibrate"]):
        found = "the recordings are of a single pendulum (tracking.markers.tip is null)" if single else "they are not"
        remedy = (
            "give the system pendulum, without calibrate" if single else "set recordings.tracking.markers.tip to null"
        )
        yield InputError(f"{where}.system.name", f"found {one['system']['name']}; {found}", remedy)
    split = one["data"]["split"]
    end = (split["length"] - 1) / split["rate_hz"]
    if one["data"]["t1_s"] > end:
        yield InputError(f"{where}.data.t1_s", f"found {one['data']['t1_s']:g}", f"a chunk ends at {end:g} s")
    key, rate = "markers.rate_hz" if recordings["source"] == "markers" else "analysis_rate_hz", analysed_hz(recordings)
    if not is_multiple(rate, split["rate_hz"]):
        remedy = f"recordings.{key}, {rate:g}, must be a multiple of it; null chooses one"
        yield InputError(f"{where}.data.split.rate_hz", f"found {split['rate_hz']:g}", remedy)


def analysed_hz(recordings: Mapping) -> float:
    """Frames per second of the recordings' angles."""
    return recordings["markers"]["rate_hz"] if recordings["source"] == "markers" else recordings["analysis_rate_hz"]


def is_multiple(value: float, step: float) -> bool:
    """Whether a value is a whole multiple of a step, 1 or more."""
    return abs(value / step - round(value / step)) < 1e-6 and round(value / step) >= 1
