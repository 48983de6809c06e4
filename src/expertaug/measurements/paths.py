"""Files of measurements: which ones a configuration names, in which order, and whether they are what they were."""

from __future__ import annotations

import glob
import re
from collections.abc import Sequence
from pathlib import Path

from expertaug.errors import InputError
from expertaug.files import sha256

SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".parquet", ".npz")
MOST = 10_000  # files
CHECKSUM = re.compile(r"([0-9a-fA-F]{64}) [ *](.+)")


def list_files(paths: str | Sequence[str], where: str = "data.files.paths") -> list[Path]:
    """Files by names or globs, each once, in natural order (2 before 10).

    Raises:
        InputError: a name or a glob finds nothing, a file is of a kind that is not read, or there are too many.
    """
    files: dict[Path, None] = {}
    for path in [paths] if isinstance(paths, str) else paths:
        several = [Path(path)] if Path(path).is_file() else []
        several = several or [Path(p) for p in glob.glob(path, recursive=True) if Path(p).is_file()]  # noqa: PTH207
        if Path(path).is_dir():
            raise InputError(where, f"'{path}' is a folder", f"name its files, as {Path(path) / '*.csv'}")
        if not several:
            raise InputError(where, f"no file at '{path}'", f"relative paths start at {Path.cwd()}")
        files |= dict.fromkeys(several)
    for path in files:
        if path.suffix.lower() not in SUFFIXES:
            raise InputError(where, f"'{path}' ends in '{path.suffix}'", f"tables are {', '.join(SUFFIXES)}")
    if len(files) > MOST:
        raise InputError(where, f"{len(files)} files", f"at most {MOST} can be used")
    return sorted(files, key=lambda path: natural_key(str(path)))


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Sorting key that puts 2 before 10."""
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p) for p in re.split(r"(\d+)", name.lower()) if p]


def read_checksums(path: str | Path, where: str) -> dict[str, str]:
    """SHA-256 by file name, from what ``sha256sum`` writes.

    Raises:
        InputError: no such file, or a line that is none of its.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(where, f"'{path}' cannot be read ({error})", "name what sha256sum wrote") from error
    checksums = {}
    for number, line in enumerate(lines, 1):
        match = CHECKSUM.fullmatch(line)
        if match is None:
            raise InputError(where, f"'{path}', line {number}: '{line}'", "expected a SHA-256 and a file's name")
        checksums[Path(match[2]).name] = match[1].lower()
    return checksums


def verify(files: Sequence[Path], checksums: str | Path, where: str = "data.files.checksums") -> None:
    """Refuse files that are not those that the checksums are of.

    Raises:
        InputError: a file has no line, or other bytes.
    """
    expected = read_checksums(checksums, where)
    for file in files:
        if file.name not in expected:
            raise InputError(where, f"'{checksums}' has no line for {file.name}", "add it with sha256sum")
        if (digest := sha256(file)) != expected[file.name]:
            raise InputError(file, f"SHA-256 is {digest}", f"{expected[file.name]} expected: copy the file again")
