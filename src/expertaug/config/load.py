"""Reading, checking and completing the configuration: one clear line for whatever is wrong, before any job starts.

Its keys are those of :mod:`expertaug.config.models`; what no single key says is checked in
:mod:`expertaug.config.checks`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path

from expertaug import presets
from expertaug.config import checks, project, recording_checks
from expertaug.config.layers import layers, merge, plain
from expertaug.config.models import Common, Configuration, Experiment
from expertaug.config.names import unknown
from expertaug.config.yaml_file import Located, read
from expertaug.errors import InputError, InputErrors
from expertaug.settings import check
from expertaug.wording import show
from expertaug_recordings.settings import ChunkKeys

__all__ = ["default_files", "load", "merge", "validate", "with_defaults"]
INCLUDE = "include"
NESTED = 9  # levels of files that include files


def load(paths: Iterable[str | Path]) -> Located:
    """Read YAML files and merge them, later ones winning, mappings key by key.

    A file's ``include`` lists files, relative to it, that it overrides in turn.

    Raises:
        InputError: a file is missing or not YAML, or does not hold a mapping.
    """
    merged = Located()
    for path in paths:
        merged = merge(merged, _with_included(Path(path)))
    return merged


def _with_included(path: Path, level: int = 0) -> Located:
    content = read(path)
    names = content.pop(INCLUDE, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{path}: {INCLUDE}", f"found {show(names)}", "give a list of files")
    if names and level == NESTED:
        raise InputError(f"{path}: {INCLUDE}", "files include each other", "remove one of them")
    merged = Located()
    for name in names:
        merged = merge(merged, _with_included(path.parent / name, level + 1))
    return merge(merged, content)


def with_defaults(paths: Iterable[str | Path]) -> list[Path]:
    """Files with the default configuration below them, as the workflow merges them; unless it is one of them."""
    files = [Path(path) for path in paths]
    defaults = default_files()
    named = {file.resolve() for file in files}
    return files if any(file.resolve() in named for file in defaults) else [*defaults, *files]


def default_files() -> list[Path]:
    """What other files override: config/config.yaml of the working directory, else of the workflow; none without."""
    folders = (Path(), project.folder())
    return next(([path] for f in folders if f and (path := f / "config" / "config.yaml").is_file()), [])


def validate(config: Mapping, stages: Collection[str] = ()) -> dict:
    """Check a configuration and complete it.

    Only the experiments of the run must be sound; of the others, those that are not are left out.

    Arguments:
        config: as read from YAML, all files merged.
        stages: names of the workflow's stages, which no experiment may have.

    Returns:
        the same with ``based_on`` and the chosen preset's ``presets`` merged, defaults filled in, ``choices``
        complete and ``tracking.uri`` set.

    Raises:
        InputErrors: everything that is wrong.
    """
    raw = plain(config)
    errors = _of_single_keys(raw)
    broken = {tuple(error.where.replace("[", ".").split(".")) for error in errors}
    complete = _top(raw, {path[0] for path in broken}, errors)
    names = {path[1] for path in broken if path[0] == "experiments" and len(path) > 1}
    sound = {name: one for name, one in config["experiments"].items() if name not in names}
    found, wrong = layers(sound, complete["preset"], set(names))
    errors += wrong
    errors += unknown(complete["run"], raw["experiments"], "run", "experiment")
    for name in raw["experiments"]:
        errors += checks.name(name, raw["experiments"], stages)
    wrong_in: dict[str, list[InputError]] = {}
    for name, one in found.items():
        complete["experiments"][name], wrong_in[name] = _experiment(name, plain(one), complete)
    errors += _of_the_run(complete["run"], wrong_in, raw["experiments"])
    complete["experiments"] = {k: one for k, one in complete["experiments"].items() if not wrong_in[k]}
    if not errors:
        errors += recording_checks.check(complete)
    if errors:
        raise InputErrors(errors)
    return complete


def _of_single_keys(raw: Mapping) -> list[InputError]:
    """What is wrong with what a file says, wherever it says it; what is missing may be inherited."""
    errors = check(Configuration, raw, "", whole=False)
    known = {error.where for error in errors}
    errors += [error for error in checks.texts(raw) if error.where not in known]
    if isinstance(raw.get("results"), str):
        errors += checks.results(_folder(raw["results"]))
    if isinstance(raw.get("seeds"), list):
        errors += checks.seeds(raw["seeds"], "seeds")
    return errors


def _top(raw: Mapping, broken: set[str], errors: list[InputError]) -> dict:
    """Everything but the experiments, completed; of what is broken the default, where there is one.

    Raises:
        InputErrors: there is none.
    """
    common = {k: v for k, v in raw.items() if k in Common.model_fields and k not in broken}
    missing = check(Common, common, "")
    if not isinstance(raw.get("experiments"), dict) and "experiments" not in broken:
        missing += check(Configuration, {**common, "experiments": None} if "experiments" in raw else common, "")
    missing = [error for error in missing if error.where not in broken]
    if errors and (missing or broken & {"methods", "run"} or not isinstance(raw.get("experiments"), dict)):
        raise InputErrors(errors)
    if missing:
        raise InputErrors(list({str(error): error for error in missing}.values()))
    complete = Common.model_validate(common).model_dump(mode="json")
    complete["results"] = _folder(complete["results"])
    if complete["tracking"]["uri"] is None:
        complete["tracking"]["uri"] = f"sqlite:///{complete['results']}/mlflow/mlflow.db"
    return complete | {"experiments": {}}


def _folder(results: str) -> str:
    try:
        return str(Path(results).expanduser()) if results.startswith("~") else results.rstrip("/") or "/"
    except RuntimeError:  # no such user
        return results


def _experiment(name: str, one: dict, complete: Mapping) -> tuple[dict, list[InputError]]:
    """An experiment with defaults and all choices, and what is wrong with it."""
    where = f"experiments.{name}"
    errors = check(Experiment, one, where)
    if errors:
        return one, errors
    filled = Experiment.model_validate(one).model_dump(mode="json")
    if (split := filled["data"].get("split")) is not None:
        try:
            chunks = ChunkKeys.from_mapping(split).at(checks.analysed_hz(complete["recordings"]), f"{where}.data.split")
        except InputError as error:
            return filled, [error]
        filled["data"]["split"] = chunks.model_dump(mode="json", exclude={"single"})
    filled["choices"] = presets.resolve(complete["preset"], filled["choices"]).model_dump()
    return filled, list(checks.experiment(where, filled, complete))


def _of_the_run(run: Iterable[str], wrong_in: Mapping[str, list[InputError]], raw: Mapping) -> list[InputError]:
    """What is wrong with the experiments of the run; what one inherits is said of the one that it is based on."""
    told: dict[str, InputError] = {}
    for name in run:
        for error in wrong_in.get(name, ()):
            here, base = name, raw[name].get("based_on")
            while base is not None:
                same = str(error).replace(f"experiments.{here}.", f"experiments.{base}.", 1)
                of_base = next((e for e in wrong_in.get(base, ()) if str(e) == same), None)
                if of_base is None:
                    break
                error, here, base = of_base, base, raw[base].get("based_on")
            told.setdefault(str(error), error)
    return list(told.values())
