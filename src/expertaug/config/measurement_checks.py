"""What a configuration says of measurements in files: files that are there, with the columns that it names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from expertaug.config.options import KnownSystem
from expertaug.errors import InputError
from expertaug.measurements.paths import list_files, read_checksums
from expertaug.measurements.settings import MeasurementSettings, column_of, label_of
from expertaug.wording import suggest

READ = 2**23  # bytes of a file that is read to see what is in it, at most


def check(where: str, one: Mapping, known: KnownSystem | None) -> Iterator[InputError]:
    """Everything that is wrong with the measurements of a completed experiment, short of reading them all."""
    data, here = one["data"], f"{where}.data.files"
    if "files" not in data:
        yield InputError(here, "missing", "give files (paths, time and columns of your measurements, and their chunks)")
        return
    settings = MeasurementSettings.from_mapping(data["files"])
    if data["calibrate"] and (one["system"]["name"] != "double_pendulum" or len(settings.columns) < 4):
        remedy = "only a double pendulum of which all four components were measured is calibrated"
        yield InputError(f"{where}.data.calibrate", "found true", remedy)
    state, parameters, inputs = (None, None, None) if known is None else (known.state, known.expert, known.known)
    wrong = [
        *_named(settings.columns, state, f"{here}.columns", "component of the state"),
        *_named(settings.z_e, parameters, f"{here}.z_e", "expert parameter"),
        *_named(settings.inputs, inputs, f"{here}.inputs", "known input of the system"),
        *_named(settings.angles, list(settings.columns), f"{here}.angles", "component with a column"),
        *_named(data["start"], state, f"{where}.data.start", "component of the state"),
    ]
    if isinstance(data["noise"], Mapping):
        wrong += _named(data["noise"], state, f"{where}.data.noise", "component of the state")
        wrong += [
            InputError(f"{where}.data.noise.{name}", "missing", "give it for every component with a column")
            for name in settings.columns
            if name not in data["noise"]
        ]
    for name in state or ():
        if name not in settings.columns and name not in data["start"]:
            remedy = f"{where}.data.start.{name}: [least, greatest] says where the first point of a chunk is sought"
            wrong.append(
                InputError(f"{here}.columns.{name}", "missing, nobody measured it", f"name a column, or {remedy}")
            )
    for name in inputs or ():
        if name not in settings.inputs:
            wrong.append(InputError(f"{here}.inputs.{name}", "missing, the system is driven by it", "name its column"))
    if known is not None and known.fields:
        wrong.append(InputError(here, "the system's states are fields", "only states of single numbers are read"))
    yield from wrong
    if settings.step_s is not None and data["t1_s"] >= (settings.length - 1) * settings.step_s + 1e-9:
        end = (settings.length - 1) * settings.step_s
        yield InputError(f"{where}.data.t1_s", f"found {data['t1_s']:g}", f"a chunk ends at {end:g} s")
    try:
        files = list_files(settings.files, f"{here}.paths")
        if settings.checksums is not None:
            read_checksums(settings.checksums, f"{here}.checksums")
        _columns(files[0], settings, here)
    except InputError as error:
        yield error


def _named(given: Mapping | Sequence[str], known: Sequence[str] | None, where: str, what: str) -> list[InputError]:
    if known is None:
        return []
    return [
        InputError(f"{where}.{name}", f"'{name}' is no {what}", suggest(name, known))
        for name in given
        if name not in known
    ]


def _columns(path: Path, settings: MeasurementSettings, where: str) -> None:
    """The first file must have the columns.

    Raises:
        InputError: it cannot be read, or lacks one.
    """
    from expertaug.measurements import expression
    from expertaug.measurements.table import read_table

    split = settings.split
    used = {f"{where}.time": column_of(settings.time).name}
    used |= {f"{where}.columns.{name}": column_of(named).name for name, named in settings.columns.items()}
    used |= {f"{where}.inputs.{name}": column_of(named).name for name, named in settings.inputs.items()}
    labels = {name: label_of(named) for name, named in settings.z_e.items()}
    used |= {f"{where}.z_e.{name}": label.name for name, label in labels.items() if label.name is not None}
    used |= {f"{where}.trajectory": settings.trajectory} if settings.trajectory is not None else {}
    used |= {f"{where}.split.column": split.column} if split.by == "column" else {}
    if split.by == "quantity":
        named = expression.names(split.quantity, f"{where}.split.quantity")
        used |= {f"{where}.split.quantity": name for name in named if name not in settings.columns}
    if path.stat().st_size > READ:  # the stage says it
        return
    known = read_table(path, settings).names
    for key, name in used.items():
        if name not in known:
            raise InputError(key, f"'{path}' has no column '{name}'", f"its columns are {', '.join(known)}")


def list_measurements(config: Mapping) -> dict[str, list[str]]:
    """Files of each experiment of the run that takes some.

    Raises:
        InputError: a name or a glob finds nothing.
    """
    found = {}
    for name in config["run"]:
        data = config["experiments"][name]["data"]
        if data["source"] == "files":
            settings = MeasurementSettings.from_mapping(data["files"])
            files = list_files(settings.files, f"experiments.{name}.data.files.paths")
            found[name] = [str(file) for file in files]
    return found
