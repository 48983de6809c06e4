"""What a configuration says of the recordings: files that are there, rates that divide each other, and their names."""

from __future__ import annotations

import glob
from collections.abc import Iterator, Mapping
from pathlib import Path

from expertaug.config.checks import is_multiple
from expertaug.config.layers import merge
from expertaug.config.names import unknown, unknown_one
from expertaug.errors import InputError
from expertaug.measurements.paths import read_checksums
from expertaug.settings import check as check_settings
from expertaug_recordings.corrections import read_corrections
from expertaug_recordings.markers.appearance import Appearance
from expertaug_recordings.names import by_name, is_series
from expertaug_recordings.settings import RecordingKeys

VIDEO_SUFFIXES = (".mp4", ".mkv", ".avi", ".mov", ".m4v", ".webm", ".mpg", ".mpeg", ".wmv", ".ogv", ".ts")


def check(config: Mapping) -> list[InputError]:
    """What is wrong with the recordings of a completed configuration; nothing where its run takes none."""
    if not _uses_recordings(config):
        return []
    errors = list(_overlay(config))
    errors += _by_recording(config["recordings"])
    for look in (_appearance, _checkerboard, _source, _corrections):
        try:
            look(config["recordings"])
        except InputError as error:
            errors.append(error)
    return errors


def _by_recording(recordings: Mapping) -> Iterator[InputError]:
    """What one recording has of its own must fit the whole block as the others' does."""
    own, where = recordings["by_recording"], "recordings.by_recording"
    if own and recordings["source"] != "videos":
        yield InputError(where, f"recordings.source is {recordings['source']}", "only videos have keys of their own")
        return
    for name, block in own.items():
        if "path" in block.get("videos", {}):
            yield InputError(f"{where}.{name}.videos.path", "is of all recordings", "set recordings.videos.path")
        merged = merge(recordings, block)
        wrong = check_settings(RecordingKeys, {k: merged[k] for k in block}, f"{where}.{name}", whole=False)
        yield from wrong
        if not wrong:
            try:
                _appearance(merged)
                _checkerboard(merged, f"{where}.{name}")
            except InputError as error:
                yield error


def _overlay(config: Mapping) -> Iterator[InputError]:
    chosen, where = config["recordings"]["overlay"], "recordings.overlay"
    known = [e for e in config["run"] if config["experiments"][e]["data"]["source"] == "recordings"]
    if chosen["experiment"] is not None and chosen["experiment"] not in known:
        what = "experiment on recordings of this run"
        yield from unknown_one(chosen["experiment"], known, f"{where}.experiment", what)
    elif chosen["variants"]:
        one = config["experiments"][chosen["experiment"] or known[0]]
        variants = [v for m in one["methods"] for v in ((m, f"{m}+") if m in one["augmented"] else (m,))]
        yield from unknown(chosen["variants"], variants, f"{where}.variants", "method of this experiment")


def _appearance(recordings: Mapping) -> None:
    if recordings["source"] != "markers":
        Appearance.from_mapping(recordings["tracking"]["markers"])


def _checkerboard(recordings: Mapping, where: str = "recordings") -> None:
    path = recordings["angles"]["rectify"]["checkerboard"]
    if path is not None and not Path(path).exists():
        where = f"{where}.angles.rectify.checkerboard"
        raise InputError(where, f"'{path}' does not exist", f"relative paths start at {Path.cwd()}")


def _source(recordings: Mapping) -> None:
    source = recordings["source"]
    if source == "rendered":
        if recordings["checksums"] is not None:
            raise InputError("recordings.checksums", "the recordings are rendered", "remove it")
        rate = recordings["rendered"]["rate_hz"]
        if not is_multiple(rate, recordings["analysis_rate_hz"]):
            remedy = f"recordings.rendered.rate_hz, {rate:g}, must be a multiple of it"
            raise InputError("recordings.analysis_rate_hz", f"found {recordings['analysis_rate_hz']:g}", remedy)
        return
    where, path = f"recordings.{source}.path", recordings[source]["path"]
    if path is None:
        remedy = f"recordings.source is {source}: set {where}, here or on the command line: "
        remedy += f"--config recordings='{{{source}: {{path: FOLDER}}}}'"
        raise InputError(where, "missing", remedy)
    if source == "videos":
        names = list(list_videos(path))
        for name in recordings["by_recording"]:
            for error in unknown_one(name, names, f"recordings.by_recording.{name}", "recording"):
                raise error
    elif not Path(path).exists():
        raise InputError(where, f"'{path}' does not exist", f"relative paths start at {Path.cwd()}")
    if recordings["checksums"] is not None:
        _checksums(recordings)


def _corrections(recordings: Mapping) -> None:
    where, path = "recordings.corrections", recordings["corrections"]
    if path is None:
        return
    if recordings["source"] == "rendered":
        names: list[str] | None = rendered_names(recordings)
    else:
        names = None if (files := _files(recordings)) is None else list(files)
    for name in read_corrections(path):
        if names is not None:
            for error in unknown_one(name, names, where, "recording"):
                raise error


def rendered_names(recordings: Mapping) -> list[str]:
    """Names of the recordings that are rendered."""
    return [f"rendered_{k:02d}" for k in range(recordings["rendered"]["count"])]


def _checksums(recordings: Mapping) -> None:
    where, path = "recordings.checksums", recordings["checksums"]
    files = _files(recordings)
    if files is None:
        raise InputError(where, "the recordings are in an archive", "set recordings.markers.sha256 instead")
    known = read_checksums(path, where)
    for file in files.values():
        if file.name not in known:
            raise InputError(where, f"'{path}' has no line for {file.name}", "add it with sha256sum")


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
        return {name: k for k, name in enumerate(rendered_names(recordings))}
    files = _files(recordings)
    return None if files is None else {name: str(path) for name, path in files.items()}


def _files(recordings: Mapping) -> dict[str, Path] | None:
    """The user's videos or marker CSVs by name; None where they are in an archive."""
    path = recordings[recordings["source"]]["path"]
    if recordings["source"] == "videos":
        return list_videos(path)
    if Path(path).is_file():
        return None
    from expertaug_recordings.ibm import list_marker_files

    return list_marker_files(path)


def _uses_recordings(config: Mapping) -> bool:
    return any(config["experiments"][name]["data"]["source"] == "recordings" for name in config["run"])


def list_videos(path: str | list[str]) -> dict[str, Path]:
    """Videos by name (the file's stem): of a folder, of a glob, or one file, or of some; folders of pictures likewise.

    Raises:
        InputError: there is none, there are two of one name, or one is called what no recording can be.
    """
    where, found = "recordings.videos.path", []
    for one in [path] if isinstance(path, str) else path:
        new = _videos_at(one)
        if not new:
            raise InputError(where, f"no video at '{one}'", f"relative paths start at {Path.cwd()}")
        found += new
    return by_name(where, dict.fromkeys(found))


def _videos_at(path: str) -> list[Path]:
    if not Path(path).is_dir():
        matched = [Path(p) for p in sorted(glob.glob(path, recursive=True))]  # noqa: PTH207
        return [p for p in matched if p.is_file() or is_series(p)]
    inside = sorted(Path(path).iterdir())
    found = [p for p in inside if (p.is_file() and p.suffix.lower() in VIDEO_SUFFIXES) or is_series(p)]
    return found or [p for p in (Path(path),) if is_series(p)]
