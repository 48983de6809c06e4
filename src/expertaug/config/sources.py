"""The user's files that a configuration names: recordings and measurements, and whether they are as it says."""

from __future__ import annotations

import glob
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from expertaug.config.layers import merge
from expertaug.config.models import Configuration, Experiment
from expertaug.config.options import KnownSystem
from expertaug.config.recording_settings import with_own
from expertaug.errors import InputError
from expertaug.measurements.paths import list_files, read_checksums
from expertaug.measurements.settings import Column, MeasurementSettings, column_of, label_of
from expertaug.settings import check
from expertaug.wording import is_multiple, unknown, unknown_keys, unknown_one
from expertaug_recordings.corrections import read_corrections
from expertaug_recordings.markers.appearance import Appearance
from expertaug_recordings.names import by_name, is_series
from expertaug_recordings.settings import RecordingKeys

VIDEO_SUFFIXES = (".mp4", ".mkv", ".avi", ".mov", ".m4v", ".webm", ".mpg", ".mpeg", ".wmv", ".ogv", ".ts")
READ = 2**23  # bytes of a file that is read to see what is in it, at most


def wrong_recordings(config: Configuration) -> list[InputError]:
    """What is wrong with the recordings of a completed configuration; nothing where its run takes none."""
    if not config.on_recordings:
        return []
    errors = [*_overlay(config), *_by_recording(config.recordings)]
    for look in (_appearance, _checkerboard, _source, _corrections):
        try:
            look(config.recordings)
        except InputError as error:
            errors.append(error)
    return errors


def _by_recording(recordings: RecordingKeys) -> Iterator[InputError]:
    """What one recording has of its own must fit the whole block as the others' does."""
    own, where = recordings.by_recording, "recordings.by_recording"
    if own and recordings.source != "videos":
        yield InputError(where, f"recordings.source is {recordings.source}", "only videos have keys of their own")
        return
    for name, block in own.items():
        if "path" in (block.videos or {}):
            yield InputError(f"{where}.{name}.videos.path", "is of all recordings", "set recordings.videos.path")
        changed = block.dump()
        merged = merge(recordings.dump(include=changed), changed)
        wrong = check(RecordingKeys, merged, f"{where}.{name}", whole=False)
        yield from wrong
        if not wrong:
            try:
                _appearance(with_own(recordings, block))
                _checkerboard(with_own(recordings, block), f"{where}.{name}")
            except InputError as error:
                yield error


def _overlay(config: Configuration) -> Iterator[InputError]:
    chosen, where, recorded = config.recordings.overlay, "recordings.overlay", config.on_recordings
    if chosen.experiment is not None and chosen.experiment not in recorded:
        what = "experiment on recordings of this run"
        yield from unknown_one(chosen.experiment, recorded, f"{where}.experiment", what)
    elif chosen.variants:
        shown = config.experiments[chosen.experiment or recorded[0]]
        variants = [v for m in shown.methods for v in ((m, f"{m}+") if m in shown.augmented else (m,))]
        yield from unknown(chosen.variants, variants, f"{where}.variants", "method of this experiment")


def _appearance(recordings: RecordingKeys) -> None:
    if recordings.source != "markers":
        Appearance.from_mapping(recordings.tracking.markers.dump())


def _checkerboard(recordings: RecordingKeys, where: str = "recordings") -> None:
    path = recordings.angles.rectify.checkerboard
    if path is not None and not Path(path).exists():
        where = f"{where}.angles.rectify.checkerboard"
        raise InputError(where, f"'{path}' does not exist", f"relative paths start at {Path.cwd()}")


def _source(recordings: RecordingKeys) -> None:
    if recordings.source == "rendered":
        if recordings.checksums is not None:
            raise InputError("recordings.checksums", "the recordings are rendered", "remove it")
        rate = recordings.rendered.rate_hz
        if not is_multiple(rate, recordings.analysis_rate_hz):
            remedy = f"recordings.rendered.rate_hz, {rate:g}, must be a multiple of it"
            raise InputError("recordings.analysis_rate_hz", f"found {recordings.analysis_rate_hz:g}", remedy)
        return
    source, path = recordings.source, _path(recordings)
    where = f"recordings.{source}.path"
    if path is None:
        remedy = f"recordings.source is {source}: set {where}, here or on the command line: "
        remedy += f"--config recordings='{{{source}: {{path: FOLDER}}}}'"
        raise InputError(where, "missing", remedy)
    if source == "videos":
        names = list(list_videos(path))
        for name in recordings.by_recording:
            for error in unknown_one(name, names, f"recordings.by_recording.{name}", "recording"):
                raise error
    elif not Path(str(path)).exists():
        raise InputError(where, f"'{path}' does not exist", f"relative paths start at {Path.cwd()}")
    if recordings.checksums is not None:
        _checksums(recordings, recordings.checksums)


def _path(recordings: RecordingKeys) -> str | list[str] | None:
    """Where the user's recordings lie."""
    return recordings.videos.path if recordings.source == "videos" else recordings.markers.path


def _corrections(recordings: RecordingKeys) -> None:
    if recordings.corrections is None:
        return
    if recordings.source == "rendered":
        names: list[str] | None = list_rendered(recordings)
    else:
        names = None if (files := _files(recordings)) is None else list(files)
    for name in read_corrections(recordings.corrections):
        if names is not None:
            for error in unknown_one(name, names, "recordings.corrections", "recording"):
                raise error


def list_rendered(recordings: RecordingKeys) -> list[str]:
    """Names of the recordings that are rendered."""
    return [f"rendered_{k:02d}" for k in range(recordings.rendered.count)]


def _checksums(recordings: RecordingKeys, path: str) -> None:
    where, files = "recordings.checksums", _files(recordings)
    if files is None:
        raise InputError(where, "the recordings are in an archive", "set recordings.markers.sha256 instead")
    listed = read_checksums(path, where)
    for file in files.values():
        if file.name not in listed:
            raise InputError(where, f"'{path}' has no line for {file.name}", "add it with sha256sum")


def list_recordings(config: Configuration) -> dict[str, str | int] | None:
    """Recordings by name: the number of a rendered one, the path of a video or of a marker CSV.

    Returns:
        None where they are in an archive that has to be unpacked first; none at all where no experiment of the run
        takes recordings.

    Raises:
        InputError: there is no recording, or there are two of one name.
    """
    if not config.on_recordings:
        return {}
    if config.recordings.source == "rendered":
        return {name: k for k, name in enumerate(list_rendered(config.recordings))}
    files = _files(config.recordings)
    return None if files is None else {name: str(path) for name, path in files.items()}


def _files(recordings: RecordingKeys) -> dict[str, Path] | None:
    """The user's videos or marker CSVs by name; None where they are in an archive."""
    path = _path(recordings)
    assert path is not None  # checked before
    if not isinstance(path, str) or recordings.source == "videos":
        return list_videos(path)
    if Path(path).is_file():
        return None
    from expertaug_recordings.ibm import list_marker_files

    return list_marker_files(path)


def list_videos(path: str | list[str]) -> dict[str, Path]:
    """Videos by name (the file's stem): of a folder, of a glob, or one file, or of some; folders of pictures likewise.

    Raises:
        InputError: there is none, there are two of one name, or one is called what no recording can be.
    """
    where, videos = "recordings.videos.path", []
    for place in [path] if isinstance(path, str) else path:
        new = _videos_at(place)
        if not new:
            raise InputError(where, f"no video at '{place}'", f"relative paths start at {Path.cwd()}")
        videos += new
    return by_name(where, dict.fromkeys(videos))


def _videos_at(path: str) -> list[Path]:
    if not Path(path).is_dir():
        matched = [Path(p) for p in sorted(glob.glob(path, recursive=True))]  # noqa: PTH207
        return [p for p in matched if p.is_file() or is_series(p)]
    inside = sorted(Path(path).iterdir())
    videos = [p for p in inside if (p.is_file() and p.suffix.lower() in VIDEO_SUFFIXES) or is_series(p)]
    return videos or [p for p in (Path(path),) if is_series(p)]


def wrong_measurements(where: str, experiment: Experiment, system: KnownSystem | None) -> Iterator[InputError]:
    """Everything that is wrong with the measurements of a completed experiment, short of reading them all."""
    data, settings, here = experiment.data, experiment.data.files, f"{where}.data.files"
    if data.calibrate and (experiment.system["name"] != "double_pendulum" or len(settings.columns) < 4):
        remedy = "only a double pendulum of which all four components were measured is calibrated"
        yield InputError(f"{where}.data.calibrate", "found true", remedy)
    state, parameters, inputs = (None, None, None) if system is None else (system.state, system.expert, system.known)
    noise = data.noise if isinstance(data.noise, dict) else {}
    yield from unknown_keys(settings.columns, state, f"{here}.columns", "component of the state")
    yield from unknown_keys(settings.z_e, parameters, f"{here}.z_e", "expert parameter")
    yield from unknown_keys(settings.inputs, inputs, f"{here}.inputs", "known input of the system")
    yield from unknown_keys(settings.angles, list(settings.columns), f"{here}.angles", "component with a column")
    yield from unknown_keys(noise, state, f"{where}.data.noise", "component of the state")
    for name in state or ():
        if name not in settings.columns and name not in data.start:
            remedy = f"{where}.data.start.{name}: [least, greatest] says where the first point of a chunk is sought"
            yield InputError(f"{here}.columns.{name}", "missing, nobody measured it", f"name a column, or {remedy}")
    for name in inputs or ():
        if name not in settings.inputs:
            yield InputError(f"{here}.inputs.{name}", "missing, the system is driven by it", "name its column")
    if system is not None and system.fields:
        yield InputError(here, "the system's states are fields", "only states of single numbers are read")
    try:
        files = list_files(settings.files, f"{here}.paths")
        if settings.checksums is not None:
            read_checksums(settings.checksums, f"{here}.checksums")
        _columns(files[0], settings, here)
    except InputError as error:
        yield error


def _columns(path: Path, settings: MeasurementSettings, where: str) -> None:
    """The first file must have the columns.

    Raises:
        InputError: it cannot be read, or lacks one.
    """
    from expertaug.measurements import expression
    from expertaug.measurements.table_files import read_table

    split = settings.split
    used = {f"{where}.time": column_of(settings.time).name}
    used |= {f"{where}.columns.{name}": column_of(named).name for name, named in settings.columns.items()}
    used |= {f"{where}.inputs.{name}": column_of(named).name for name, named in settings.inputs.items()}
    for block, entries in (("columns", settings.columns), ("inputs", settings.inputs)):
        for name, column in entries.items():
            _formula(column_of(column), f"{where}.{block}.{name}.formula")
    labels = {name: label_of(named) for name, named in settings.z_e.items()}
    used |= {f"{where}.z_e.{name}": label.name for name, label in labels.items() if label.name is not None}
    used |= {f"{where}.date": settings.date} if settings.date is not None else {}
    used |= {f"{where}.trajectory": settings.trajectory} if settings.trajectory is not None else {}
    used |= {f"{where}.split.column": split.column} if split.by == "column" else {}
    if split.by == "quantity":
        named = expression.names(split.quantity, f"{where}.split.quantity")
        used |= {f"{where}.split.quantity": name for name in named if name not in settings.columns}
    if path.stat().st_size > READ:  # the stage says it
        return
    columns = read_table(path, settings).names
    for key, name in used.items():
        if name not in columns:
            raise InputError(key, f"'{path}' has no column '{name}'", f"its columns are {', '.join(columns)}")


def _formula(column: Column, where: str) -> None:
    """A column's formula must be arithmetic with its numbers.

    Raises:
        InputError: it is not.
    """
    from expertaug.measurements import expression

    if column.formula is None:
        return
    if other := [name for name in expression.names(column.formula, where) if name != "x"]:
        raise InputError(where, f"'{column.formula}' names '{other[0]}'", "the column's numbers are called x")


def list_measurements(config: Configuration) -> dict[str, list[str]]:
    """Files of each experiment of the run that takes some.

    Raises:
        InputError: a name or a glob finds nothing, or a name means something to the workflow.
    """
    measurements: dict[str, list[str]] = {}
    for name in config.run:
        data, where = config.experiments[name].data, f"experiments.{name}.data.files.paths"
        if data.source == "files":
            measurements[name] = [str(file) for file in list_files(data.files.files, where)]
            for file in measurements[name]:
                if file.startswith("-") or set(file) & set("{}"):
                    what = "begins with a dash" if file.startswith("-") else "has braces"
                    raise InputError(where, f"'{file}' {what}, which the workflow takes otherwise", "rename it")
    return measurements


def refuse_within_results(
    config: Configuration,
    recordings: Mapping[str, str | int] | None,
    measurements: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Refuse the user's recordings, measurements and checksums in the results folder: Snakemake deletes an output
    before it makes it anew.

    Arguments:
        recordings: files by name (:func:`list_recordings`); a rendered one's is a number.
        measurements: files by experiment, where there are any.

    Raises:
        InputError: one of them lies there, also by way of a link.
    """
    block = config.recordings
    named = [("recordings.checksums", block.checksums)]
    if block.source != "rendered" and recordings != {}:
        named += [(f"recordings.{block.source}.path", path) for path in (recordings or {"": _path(block)}).values()]
    for name, files in (measurements or {}).items():
        where = f"experiments.{name}.data.files"
        named += [(f"{where}.paths", file) for file in files]
        named += [(f"{where}.checksums", config.experiments[name].data.files.checksums)]
    folder = Path(config.results).resolve()
    for where, path in named:
        if path is None:
            continue
        parts = (Path(str(path)).resolve(), Path(str(path)).parent.resolve())
        if any(part.is_relative_to(folder) for part in parts):
            problem = f"'{path}' lies in the results folder '{config.results}', whose files are made anew and deleted"
            raise InputError(where, problem, "move it elsewhere, or choose another results folder")
