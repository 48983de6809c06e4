"""Reading, checking and completing the configuration: one clear line for whatever is wrong, before any job starts.

Its keys are those of :mod:`expertaug.config.models`; what no single key says is checked in
:mod:`expertaug.config.checks`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from expertaug import presets
from expertaug.config import checks, grid, options
from expertaug.config.layers import inherit, merge, plain, under
from expertaug.config.models import Common, Configuration, Experiment
from expertaug.config.sources import wrong_recordings
from expertaug.config.yaml_file import Located, read
from expertaug.errors import InputError, InputErrors
from expertaug.presets import Preset
from expertaug.settings import Raw, check
from expertaug.source_files import project
from expertaug.wording import show, unknown

__all__ = ["complete_configuration", "default_files", "load", "merge", "validate", "with_defaults"]
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
    folders = (Path(), project())
    return next(([path] for f in folders if f and (path := f / "config" / "config.yaml").is_file()), [])


def complete_configuration(config: Located, stages: checks.Stages = MappingProxyType({})) -> Configuration:
    """A configuration as the workflow uses it: checked and completed, with a method for each point of its grids.

    Arguments:
        config: as read from YAML, all files merged.
        stages: of the workflow by name: no experiment may be called like one, or like another's table.

    Raises:
        InputError: everything that is wrong.
    """
    return grid.expand(validate(config, stages), lambda change: validate(merge(config, change)))


def validate(config: Located | dict[str, Any], stages: checks.Stages = MappingProxyType({})) -> Configuration:
    """Check a configuration and complete it.

    Only the experiments of the run must be sound; of the others, those that are not are left out.

    Arguments:
        config: as read from YAML, all files merged.
        stages: of the workflow by name: no experiment may be called like one, or like another's table.

    Returns:
        the same with ``based_on`` and the chosen preset's ``presets`` merged, defaults filled in, ``choices``
        complete and ``tracking.uri`` set.

    Raises:
        InputErrors: everything that is wrong.
    """
    raw = plain(config)
    errors = _of_single_keys(raw)
    broken = {tuple(error.where.replace("[", ".").split(".")) for error in errors}
    common = _common(raw, {path[0] for path in broken}, errors)
    names = {path[1] for path in broken if path[0] == "experiments" and len(path) > 1}
    experiments = raw["experiments"]
    sound = {name: block for name, block in config["experiments"].items() if name not in names}
    blocks, wrong = inherit(sound, names)
    errors += wrong
    layered = {name: under(common.preset, block, f"experiments.{name}", errors) for name, block in blocks.items()}
    errors += unknown(common.run, experiments, "run", "experiment")
    for name in experiments:
        errors += checks.check_name(name, experiments, stages)
    complete: dict[str, Experiment] = {}
    wrong_in: dict[str, list[InputError]] = {}
    for name, block in layered.items():
        experiment, wrong_in[name] = _experiment(f"experiments.{name}", plain(block), common)
        if experiment is not None:
            complete[name] = experiment
    for preset in presets.NAMES:
        if preset != common.preset:
            for name, wrong in _of_another_preset(preset, {name: blocks[name] for name in complete}, common):
                wrong_in[name] += wrong
    errors += checks.check_data_curves(complete, common.run)
    errors += _of_the_run(common.run, wrong_in, {name: block.get("based_on") for name, block in sound.items()})
    whole = Configuration.model_construct(**dict(common), experiments=complete)
    if not errors:
        errors += wrong_recordings(whole)
    if errors:
        raise InputErrors(errors)
    return whole


def _of_single_keys(raw: Raw) -> list[InputError]:
    """What is wrong with what a file says, wherever it says it; what is missing may be inherited."""
    errors = check(Configuration, raw, "", whole=False)
    wrong = {error.where for error in errors}
    errors += [error for error in checks.check_texts(raw) if error.where not in wrong]
    if isinstance(results := raw.get("results"), str):
        errors += checks.check_results(_folder(results))
    return errors


def _common(raw: Raw, broken: set[str], errors: list[InputError]) -> Common:
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
    complete = Common.completed(common)
    results, tracking = _folder(complete.results), complete.tracking
    if tracking.uri is None:
        tracking = tracking.model_copy(update={"uri": f"sqlite:///{results}/mlflow/mlflow.db"})
    return complete.model_copy(update={"results": results, "tracking": tracking})


def _folder(results: str) -> str:
    try:
        return str(Path(results).expanduser()) if results.startswith("~") else results.rstrip("/") or "/"
    except RuntimeError:  # no such user
        return results


def _experiment(where: str, block: Raw, common: Common) -> tuple[Experiment | None, list[InputError]]:
    """An experiment with defaults and all choices, None where it is wrong, and what is wrong with it."""
    errors = check(Experiment, block, where)
    if errors:
        return None, errors
    experiment = Experiment.completed(block)
    data = experiment.data
    if data.split is not None:
        try:
            chunks = data.split.at(checks.analysed_hz(common.recordings), f"{where}.data.split")
        except InputError as error:
            return None, [error]
        data = data.model_copy(update={"split": chunks})
    choices = presets.resolve(common.preset, experiment.choices.dump())
    experiment = experiment.model_copy(update={"data": data, "choices": choices})
    errors = list(checks.check_experiment(where, experiment, common))
    return (None if errors else experiment), errors


def _of_another_preset(
    preset: Preset, blocks: Mapping[str, Located], common: Common
) -> Iterator[tuple[str, list[InputError]]]:
    """Names of experiments, with what is wrong with keys that they override under a preset which is not the chosen one.

    Arguments:
        blocks: the experiments, with the keys of what they are based on.
    """
    other = common.model_copy(update={"preset": preset})
    for name, block in blocks.items():
        if over := (block.get("presets") or {}).get(preset):
            where, wrong = f"experiments.{name}", []
            experiment = under(preset, block, where, wrong)
            wrong += _experiment(where, plain(experiment), other)[1]
            own = {f"{where}.{path}" for path in _paths(over)}
            within = f"{where}.presets.{preset}"
            # The experiment may have got another system or part since: what its kind alone does not know is no mistake.
            wrong = [e for e in wrong if e.where in own and not options.is_of_another_kind(e)]
            yield name, [InputError(e.where.replace(where, within, 1), e.found, e.remedy) for e in wrong]


def _paths(block: Located, before: str = "") -> Iterator[str]:
    """Dotted paths of what a block holds, its blocks' included."""
    for name, value in block.items():
        yield f"{before}{name}"
        if isinstance(value, Located):
            yield from _paths(value, f"{before}{name}.")


def _of_the_run(
    run: Iterable[str], wrong_in: dict[str, list[InputError]], based_on: dict[str, str | None]
) -> list[InputError]:
    """What is wrong with the experiments of the run; what one inherits is said of the one that it is based on."""
    distinct: dict[str, InputError] = {}
    for name in run:
        for error in wrong_in.get(name, ()):
            here, base = name, based_on[name]
            while base is not None:
                same = str(error).replace(f"experiments.{here}.", f"experiments.{base}.", 1)
                of_base = next((e for e in wrong_in.get(base, ()) if str(e) == same), None)
                if of_base is None:
                    break
                error, here, base = of_base, base, based_on[base]
            distinct.setdefault(str(error), error)
    return list(distinct.values())
