"""What a schema cannot say about a configuration: names that exist, ranges that agree, paths that are there."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from expertaug import source_files
from expertaug.config import signatures, stage_code, study_checks
from expertaug.config.names import require, require_all, require_keys, require_parameters, suggest
from expertaug.errors import InputError
from expertaug.recordings.markers.appearance import Appearance

# Folders beside those of the experiments in the results folder.
RESERVED = ("recordings", "tables", "figures", "mlflow", "published", "logs", "benchmarks")
TARGETS = (*stage_code.STAGES, "recordings", "studies", "report", "all", "everything")
NOT_SYSTEMS = ("base", "solver", "simulate")
# Files of an experiment are called after it and one of these.
ENDINGS = ("long", "published", "out_of_expertise", "prior_width", "during_training", "grid")
VIDEO_SUFFIXES = (".mp4", ".mkv", ".avi", ".mov", ".m4v", ".webm", ".mpg", ".mpeg", ".wmv", ".ogv", ".ts")
CHECKSUM = re.compile(r"([0-9a-fA-F]{64}) [ *](.+)")
TEXT_NUMBER = re.compile(r"[-+]?(\d[\d_]*\.?\d*|\.\d+)([eE][-+]?\d+)?")


def check(config: Mapping) -> None:
    """Check a completed configuration.

    Raises:
        InputError: the first thing that is wrong.
    """
    for path, value in _texts(config, ""):
        number = number_in(value) if "e" in value.lower() else None
        if number:
            raise InputError(
                path, f"found '{value}', which YAML takes for a text", f"write {number}, or name it otherwise"
            )
    _writable("results", Path(config["results"]))
    _seeds(config)
    require_all(config["run"], config["experiments"], "run", "experiment")
    for name, experiment in config["experiments"].items():
        if name in RESERVED:
            raise InputError(f"experiments.{name}", "the results folder needs this name", "choose another name")
        if name in TARGETS:
            raise InputError(f"experiments.{name}", "a stage of the workflow has this name", "choose another name")
        for ending in ENDINGS:
            if name.endswith(f"_{ending}") and name.removesuffix(f"_{ending}") in config["experiments"]:
                found = f"the files of '{name.removesuffix(f'_{ending}')}' would have the same names"
                raise InputError(f"experiments.{name}", found, "choose another name")
        _experiment(f"experiments.{name}", experiment, config)
    if _uses_recordings(config):
        _recordings(config["recordings"])
        _overlay(config)


def number_in(text: str) -> str | None:
    """The number in a text as YAML wants it written (``1e-3`` → ``1.0e-3``); None where it holds no number."""
    text = text.strip()
    match = TEXT_NUMBER.fullmatch(text)
    if match is None:
        return None
    if match[2] is None:
        return text
    mantissa, exponent = text[: -len(match[2])], match[2][1:]
    mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
    return f"{mantissa}e{exponent if exponent[0] in '+-' else f'+{exponent}'}"


def _texts(value: object, path: str) -> Iterator[tuple[str, str]]:
    """Every text of a configuration but names and labels, with its key path."""
    if isinstance(value, str):
        yield path, value
    elif isinstance(value, Mapping):
        for key, item in value.items():
            if key not in ("label", "sha256", "results", "path", "rate_provenance", "experiment"):
                yield from _texts(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for k, item in enumerate(value):
            yield from _texts(item, f"{path}[{k}]")


def _writable(where: str, folder: Path) -> None:
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir():
        raise InputError(where, f"'{existing}' is no folder", "choose another results folder")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(where, f"'{existing}' cannot be written", "choose a writable results folder")


def _seeds(config: Mapping) -> None:
    seeds = config["seeds"]
    for k, seed in enumerate(seeds):
        if seed in seeds[:k]:
            raise InputError(f"seeds[{k}]", f"{seed} is there twice", "give each seed once")


def _experiment(where: str, experiment: Mapping, config: Mapping) -> None:
    _system(f"{where}.system.name", experiment["system"]["name"])
    methods = config["methods"]
    for part, settings in experiment["model"].items():
        known = signatures.of_kind(part, settings["kind"], f"{where}.model.{part}.kind")
        require_keys(f"{where}.model.{part}", set(settings) - {"kind"}, known)
    require_keys(f"{where}.system", set(experiment["system"]) - {"name"}, _system_keys(where, experiment["system"]))
    require_all(experiment["methods"], methods, f"{where}.methods", "method")
    for method in experiment["methods"]:
        _method(method, methods[method], experiment, where)
    # Each method takes of these what is its own objective's.
    objectives = {
        methods[m].get("objective", "aphynity") for m in experiment["methods"] if methods[m]["kind"] != "mean"
    }
    known = [key for kind in sorted(objectives) for key in signatures.of_kind("objective", kind, "objective")]
    for key in ("training", "finetuning") if known else ():
        require_keys(f"{where}.{key}.objective", experiment.get(key, {}).get("objective", {}), known)
    require_all(experiment["augmented"], experiment["methods"], f"{where}.augmented", "method of this experiment")
    for k, method in enumerate(experiment["augmented"]):
        if methods[method]["kind"] == "mean":
            raise InputError(
                f"{where}.augmented[{k}]", f"'{method}' is of kind mean", "only hybrid methods can be augmented"
            )
    if experiment["augmented"]:
        for key in ("augmentation", "finetuning"):
            if key not in experiment:
                raise InputError(f"{where}.{key}", "missing", "methods under augmented need it")
    data = experiment["data"]
    (_simulation if data["source"] == "simulation" else _chunks)(where, experiment, config)
    study_checks.check(where, experiment, methods)


def _method(method: str, build: Mapping, experiment: Mapping, used: str) -> None:
    """A method's objective and what it changes of the system, as an experiment uses them."""
    where = f"methods.{method}"
    if build["kind"] == "mean":
        return
    objective = build.get("objective", "aphynity")
    known = signatures.of_kind("objective", objective, f"{where}.objective")
    if signatures.takes("objective", objective, "prior", f"{where}.objective") and "augmentation" not in experiment:
        raise InputError(f"{used}.augmentation", "missing", f"the objective {objective} needs its prior")
    over, there = experiment["overrides"].get(method, {}), f"{used}.overrides.{method}"
    for key in ("training", "finetuning"):
        require_keys(f"{there}.{key}.objective", over.get(key, {}).get("objective", {}), known)
    for part, settings in over.get("model", {}).items():
        kind = settings.get("kind", experiment["model"].get(part, {}).get("kind", ""))
        require_keys(
            f"{there}.model.{part}", set(settings) - {"kind"}, signatures.of_kind(part, kind, f"{there}.model.{part}")
        )
    system = {**experiment["system"], **build.get("system", {})}
    require_keys(f"{where}.system", set(build.get("system", {})) - {"name"}, _system_keys(where, system))


def _system_keys(where: str, system: Mapping) -> list[str]:
    return signatures.of_system(system["name"], f"{where}.system.name")


def _system(where: str, name: str) -> None:
    if "." in name:
        source_files.find(where, name)
        return
    known = [module for module in source_files.modules_in("expertaug.systems") if module not in NOT_SYSTEMS]
    if name not in known:
        remedy = f"{suggest(name, known)}, or the dotted path of a module elsewhere"
        raise InputError(where, f"'{name}' is no system", remedy)


def _simulation(where: str, experiment: Mapping, config: Mapping) -> None:
    data = experiment["data"]
    if data["t1_s"] >= data["t2_s"]:
        raise InputError(
            f"{where}.data.t1_s", f"found {data['t1_s']:g}, t2_s is {data['t2_s']:g}", "t1_s must be less than t2_s"
        )
    for key in ("t1_s", "t2_s"):
        if not _is_multiple(data[key], data["step_s"]):
            raise InputError(
                f"{where}.data.{key}", f"found {data[key]:g}", f"give a multiple of step_s, {data['step_s']:g}"
            )
    first, sets = next(iter(data["sets"])), data["sets"]
    system = experiment["system"]["name"]
    signatures.require_simulation(system, f"{where}.system.name")
    for part, attribute in (("z_e", "expert_parameters"), ("z_a", "interaction_parameters")):
        known = signatures.parameters(system, attribute, f"{where}.system.name")
        if known is not None:
            require_parameters(f"{where}.data.sets.{first}.{part}", sets[first][part], known, f"the system {system}")
    for name, one in sets.items():
        for part in ("z_e", "z_a"):
            require_parameters(f"{where}.data.sets.{name}.{part}", one[part], sets[first][part], f"the set {first}")
    if "augmentation" in experiment:
        prior = experiment["augmentation"]["prior"]
        require_parameters(f"{where}.augmentation.prior", prior, sets[first]["z_e"], "the sets' z_e")


def _chunks(where: str, experiment: Mapping, config: Mapping) -> None:
    split, recordings = experiment["data"]["split"], config["recordings"]
    total = split["train_share"] + split["validation_share"] + split["test_share"]
    if abs(total - 1) > 1e-6:
        raise InputError(f"{where}.data.split", f"the shares sum to {total:g}", "they must sum to 1")
    for key in ("stride", "evaluation_stride"):
        if split[key] > split["length"]:
            raise InputError(
                f"{where}.data.split.{key}", f"found {split[key]}", f"give at most the length, {split['length']}"
            )
    end = (split["length"] - 1) / split["rate_hz"]
    if experiment["data"]["t1_s"] > end:
        raise InputError(f"{where}.data.t1_s", f"found {experiment['data']['t1_s']:g}", f"a chunk ends at {end:g} s")
    key = "markers.rate_hz" if recordings["source"] == "markers" else "analysis_rate_hz"
    rate = recordings["markers"]["rate_hz"] if recordings["source"] == "markers" else recordings["analysis_rate_hz"]
    if not _is_multiple(rate, split["rate_hz"]):
        remedy = f"recordings.{key}, {rate:g}, must be a multiple of it"
        raise InputError(f"{where}.data.split.rate_hz", f"found {split['rate_hz']:g}", remedy)


def _overlay(config: Mapping) -> None:
    chosen, where = config["recordings"]["overlay"], "recordings.overlay"
    known = [e for e in config["run"] if config["experiments"][e]["data"]["source"] == "recordings"]
    if chosen["experiment"] is not None:
        require(chosen["experiment"], known, f"{where}.experiment", "experiment on recordings of this run")
    if chosen["variants"]:
        one = config["experiments"][chosen["experiment"] or known[0]]
        variants = [v for m in one["methods"] for v in ((m, f"{m}+") if m in one["augmented"] else (m,))]
        require_all(chosen["variants"], variants, f"{where}.variants", "method of this experiment")


def _recordings(recordings: Mapping) -> None:
    source = recordings["source"]
    if source != "markers":
        Appearance.from_mapping(recordings["tracking"]["markers"])
    if source == "rendered":
        if recordings["checksums"] is not None:
            raise InputError("recordings.checksums", "the recordings are rendered", "remove it")
        rate = recordings["rendered"]["rate_hz"]
        if not _is_multiple(rate, recordings["analysis_rate_hz"]):
            remedy = f"recordings.rendered.rate_hz, {rate:g}, must be a multiple of it"
            raise InputError("recordings.analysis_rate_hz", f"found {recordings['analysis_rate_hz']:g}", remedy)
        return
    where, path = f"recordings.{source}.path", recordings[source]["path"]
    if path is None:
        raise InputError(where, "missing", f"recordings.source is {source}: say where they are")
    if source == "videos":
        list_videos(path)
    elif not Path(path).exists():
        raise InputError(where, f"'{path}' does not exist", f"relative paths start at {Path.cwd()}")
    if recordings["checksums"] is not None:
        _checksums(recordings)


def _checksums(recordings: Mapping) -> None:
    where, path = "recordings.checksums", recordings["checksums"]
    files = _files(recordings)
    if files is None:
        raise InputError(where, "the recordings are in an archive", "set recordings.markers.sha256 instead")
    known = read_checksums(path)
    for file in files.values():
        if file.name not in known:
            raise InputError(where, f"'{path}' has no line for {file.name}", "add it with sha256sum")


def read_checksums(path: str) -> dict[str, str]:
    """SHA-256 by file name, from what ``sha256sum`` writes.

    Raises:
        InputError: no such file, or a line that is none of its.
    """
    where = "recordings.checksums"
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(where, f"'{path}' cannot be read ({error})", "name what sha256sum wrote") from error
    found = {}
    for number, line in enumerate(lines, 1):
        match = CHECKSUM.fullmatch(line)
        if match is None:
            raise InputError(where, f"'{path}', line {number}: '{line}'", "expected a SHA-256 and a file's name")
        found[Path(match[2]).name] = match[1].lower()
    return found


def list_recordings(config: Mapping) -> dict[str, str | int] | None:
    """Recordings by name: the number of a rendered one, the path of a video or of a marker CSV.

    Returns:
        None where they are in an archive that has to be unpacked first; none at all where no experiment of the run
        takes recordings.

    Raises:
        InputError: there is no recording, or there are two of one name.
    """
    recordings = config["recordings"]
    source = recordings["source"]
    if not _uses_recordings(config):
        return {}
    if source == "rendered":
        return {f"rendered_{k:02d}": k for k in range(recordings["rendered"]["count"])}
    files = _files(recordings)
    return None if files is None else {name: str(path) for name, path in files.items()}


def _files(recordings: Mapping) -> dict[str, Path] | None:
    """The user's videos or marker CSVs by name; None where they are in an archive."""
    path = recordings[recordings["source"]]["path"]
    if recordings["source"] == "videos":
        return list_videos(path)
    if Path(path).is_file():
        return None
    from expertaug.recordings.imports.ibm import list_marker_files

    return list_marker_files(path)


def _uses_recordings(config: Mapping) -> bool:
    return any(config["experiments"][name]["data"]["source"] == "recordings" for name in config["run"])


def list_videos(path: str) -> dict[str, Path]:
    """Videos by name (the file's stem): of a folder, of a glob, or one file.

    Raises:
        InputError: there is none, or there are two of one name.
    """
    where = "recordings.videos.path"
    if Path(path).is_dir():
        found = [p for p in Path(path).iterdir() if p.is_file() and p.suffix.lower() in VIDEO_SUFFIXES]
    else:
        found = [Path(p) for p in sorted(glob.glob(path, recursive=True)) if Path(p).is_file()]  # noqa: PTH207
    if not found:
        raise InputError(where, f"no video at '{path}'", f"relative paths start at {Path.cwd()}")
    names: dict[str, Path] = {}
    for video in sorted(found):
        other = next((p for name, p in names.items() if name.lower() == video.stem.lower()), None)
        if other is not None:
            raise InputError(where, f"two files of one name: {other} and {video}", "rename or remove one")
        names[video.stem] = video
    return names


def _is_multiple(value: float, step: float) -> bool:
    return abs(value / step - round(value / step)) < 1e-6 and round(value / step) >= 1
