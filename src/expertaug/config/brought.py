"""What a user brings never lies where the workflow writes: Snakemake deletes an output before it makes it anew."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from expertaug.errors import InputError


def check(
    config: Mapping,
    recordings: Mapping[str, str | int] | None,
    measurements: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Refuse the user's recordings, measurements and checksums in the results folder.

    Arguments:
        config: the completed configuration.
        recordings: files by name (:func:`expertaug.config.checks.list_recordings`); a rendered one's is a number.
        measurements: files by experiment, where there are any.

    Raises:
        InputError: one of them lies there, also by way of a link.
    """
    block = config["recordings"]
    source, checksums = block["source"], block["checksums"]
    named = [("recordings.checksums", checksums)] if checksums is not None else []
    if source != "rendered" and recordings != {}:
        paths = list(recordings.values()) if recordings else [block[source]["path"]]
        named += [(f"recordings.{source}.path", path) for path in paths]
    for name, files in (measurements or {}).items():
        where = f"experiments.{name}.data.files"
        listed = config["experiments"][name]["data"]["files"]["checksums"]
        named += [(f"{where}.paths", file) for file in files]
        named += [(f"{where}.checksums", listed)] if listed is not None else []
    folder = Path(config["results"]).resolve()
    for where, path in named:
        if any(one.is_relative_to(folder) for one in (Path(path).resolve(), Path(path).parent.resolve())):
            found = f"'{path}' lies in the results folder '{config['results']}', whose files are made anew and deleted"
            raise InputError(where, found, "move it elsewhere, or choose another results folder")
