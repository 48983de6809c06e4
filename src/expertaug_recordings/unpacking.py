"""Unpacking archives that nobody vouches for."""

from __future__ import annotations

import lzma
import shutil
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path, PurePosixPath
from typing import IO, NamedTuple

from expertaug.errors import InputError

MAX_UNPACKED_BYTES = 2**30  # of the files that are wanted: the dataset's own CSVs take 12 MB
MAX_RATIO = 50  # of unpacked to packed bytes, in archives that hold more than that; a bomb's is about 1000
MAX_MEMBERS = 100_000
MAX_HEADER_BYTES = 2**20
LONGEST_NAME = 250
DEEPEST = 32  # folders in folders
EXTENDED = (
    tarfile.XHDTYPE,
    tarfile.XGLTYPE,
    tarfile.SOLARIS_XHDTYPE,
    tarfile.GNUTYPE_LONGNAME,
    tarfile.GNUTYPE_LONGLINK,
)
# By its first bytes: tarfile's own guess takes any five bytes for the old .lzma, which may then want gigabytes.
PACKINGS = {b"\x1f\x8b": "gz", b"BZh": "bz2", b"\xfd7zXZ": "xz"}
DAMAGE = (  # what the standard library raises on archives that are not what they say
    tarfile.TarError,
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    LookupError,
    MemoryError,
    OverflowError,
    RuntimeError,
    ValueError,
)


def unpack(archive: Path, folder: Path, choose: Callable[[list[PurePosixPath]], Iterable[PurePosixPath]]) -> None:
    """Unpack some members of a .tar (plain or packed) or .zip into ``folder``; time grows with their number alone.

    Arguments:
        archive, folder: from where and to where.
        choose: picks from the files in the archive those that are wanted.

    Raises:
        InputError: a damaged archive, one of too many members, a member that would land outside of ``folder`` (``..``,
            an absolute path, a link), two members of one name, or one that unpacks without end.
        OSError: the folder cannot be written.
    """
    try:
        tar = _open_tar(archive)
        if tar is not None:
            with tar:
                members = _members(archive, tar)
                listed = [Member(m.name, m.size, m.isfile(), not (m.isfile() or m.isdir())) for m in members]
                _extract(folder, choose_members(listed, choose, archive), lambda name: tar.extractfile(name))
                while tar.fileobj.read(2**20):  # a packed tar's checksum is at its end
                    pass
        elif zipfile.is_zipfile(archive):
            with zipfile.ZipFile(archive) as pack:
                infos = pack.infolist()
                if len(infos) > MAX_MEMBERS:
                    raise _too_many(archive)
                listed = [
                    Member(i.filename, i.file_size, not i.is_dir(), stat.S_ISLNK(i.external_attr >> 16)) for i in infos
                ]
                _extract(folder, choose_members(listed, choose, archive), pack.open)
        else:
            raise InputError(archive, "neither a tar nor a zip archive", "give the dataset's .tar.gz or .zip")
    except DAMAGE as error:
        raise InputError(archive, f"damaged archive ({error})", "get it again") from error
    except OSError as error:
        if error.errno is not None:  # a full disk; gzip's own complaints about the data carry no number
            raise
        raise InputError(archive, f"damaged archive ({error})", "get it again") from error


def _open_tar(archive: Path) -> tarfile.TarFile | None:
    with archive.open("rb") as file:
        start = file.read(8)
    packing = next((name for magic, name in PACKINGS.items() if start.startswith(magic)), "")
    try:
        return tarfile.open(archive, f"r:{packing}", tarinfo=_Header)
    except tarfile.ReadError:
        return None


class _Header(tarfile.TarInfo):
    """A member's header; an extended one, which is read into memory at once, must not be vast."""

    @classmethod
    def frombuf(cls, buf: bytes, encoding: str, errors: str) -> _Header:
        made = super().frombuf(buf, encoding, errors)
        if made.type in EXTENDED and made.size > MAX_HEADER_BYTES:
            raise tarfile.ReadError(f"a header of {made.size} bytes")
        return made


def _members(archive: Path, tar: tarfile.TarFile) -> list[tarfile.TarInfo]:
    """A tar's members; what would unpack without end is refused before it is unpacked."""
    members, size = [], 0
    limit = max(MAX_UNPACKED_BYTES, MAX_RATIO * archive.stat().st_size)
    for member in tar:
        members.append(member)
        size += member.size
        if size > limit:
            raise InputError(archive, f"holds more than {limit >> 20} MiB", "do not trust this archive")
        if len(members) > MAX_MEMBERS:
            raise _too_many(archive)
    return members


def _too_many(archive: Path) -> InputError:
    return InputError(archive, f"holds more than {MAX_MEMBERS} members", "do not trust this archive")


class Member(NamedTuple):
    """What an archive says of one of its members: its name, its size in bytes, whether it is a file, and whether it is
    a link or a device."""

    name: str
    size: int
    is_file: bool
    is_odd: bool


def choose_members(
    members: Sequence[Member],
    choose: Callable[[list[PurePosixPath]], Iterable[PurePosixPath]],
    where: object = "archive",
) -> list[tuple[PurePosixPath, str]]:
    """The files that are unpacked: where to, and the name of the member.

    Arguments:
        members: of the archive.
        choose: as of :func:`unpack`.
        where: what messages call the archive.

    Raises:
        InputError: as of :func:`unpack`, by what the archive says of its members.
    """
    if odd := [member.name for member in members if member.is_odd]:
        raise InputError(where, f"member '{odd[0]}' is a link or a device", "an archive of plain files is needed")
    for name, *_ in members:
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts or "\\" in name or ":" in name:
            raise InputError(where, f"member '{name}' would land outside of the folder", "do not trust this archive")
        if max(len(part.encode(errors="surrogateescape")) for part in path.parts or ("",)) > LONGEST_NAME:
            raise InputError(where, f"member '{name}' has too long a name", f"at most {LONGEST_NAME} bytes can be used")
        if len(path.parts) > DEEPEST:
            raise InputError(
                where, f"member '{name}' lies {len(path.parts)} folders deep", f"at most {DEEPEST} can be used"
            )
    files: dict[PurePosixPath, tuple[str, int]] = {}
    for name, size, is_file, _ in members:
        path = PurePosixPath(name)
        if path in files:
            raise InputError(where, f"two members are called '{name}'", "pack it again")
        if is_file:
            files[path] = (name, size)
    both = next((path for path in files if any(parent in files for parent in path.parents)), None)
    if both is not None:
        raise InputError(where, f"member '{both}' lies in a folder that is a file as well", "pack it again")
    chosen = list(choose(list(files)))
    if sum(files[path][1] for path in chosen) > MAX_UNPACKED_BYTES:
        raise InputError(where, f"its files take more than {MAX_UNPACKED_BYTES >> 20} MiB", "do not trust this archive")
    return [(path, files[path][0]) for path in chosen]


def _extract(
    folder: Path, chosen: Iterable[tuple[PurePosixPath, str]], open_member: Callable[[str], IO[bytes] | None]
) -> None:
    for path, name in chosen:
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        with open_member(name) as source, target.open("wb") as stream:
            shutil.copyfileobj(source, stream)
