"""Files that a reader never sees half of, and readers that believe nothing of what a file claims."""

from __future__ import annotations

import fcntl
import hashlib
import json
import logging
import math
import os
import re
import shutil
import tempfile
import zipfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import IO, TYPE_CHECKING

from expertaug.errors import InputError

if TYPE_CHECKING:
    import numpy as np

logger = logging.getLogger(__name__)

TOLD_S = 5.0  # of waiting for a lock, after which a line says so
RATIO, UNSUSPECTED = 200, 2**26  # what measured data is never compressed by, and the bytes from which that is asked


@contextmanager
def atomic(path: str | Path) -> Iterator[Path]:
    """Yield a temporary path and move it to ``path`` when the block ends well; remove it otherwise.

    The temporary file has the name of ``path``, in a hidden folder beside it: libraries that look at the suffix write
    the same format.  What writers of the same file left behind when they were killed is removed first.

    Raises:
        InputError: the folder is read-only or the disk is full.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep(path)
        folder, lock = _workplace(path)
    except OSError as error:
        raise InputError(path, f"cannot be written ({error.strerror})", "choose a writable results folder") from error
    temporary = folder / path.name
    try:
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    except Exception as error:
        reason = _reason(error)
        if reason is None:
            raise
        remedy = "free some space or choose another results folder"
        raise InputError(path, f"cannot be written ({reason})", remedy) from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        lock.close()


def _workplace(path: Path) -> tuple[Path, IO[str]]:
    """A new folder for one writer of ``path``, and the lock in it that lasts as long as the writer lives."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=f".{path.name}.tmp-", dir=path.parent))
        try:
            lock = (folder / "lock").open("w")
        except FileNotFoundError:  # swept as it was not locked yet
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if (folder / "lock").exists():
                return folder, lock
        except BlockingIOError:
            pass
        except OSError:  # a file system without locks: nobody sweeps there
            return folder, lock
        lock.close()


def _sweep(path: Path) -> None:
    """Remove the folders of writers of ``path`` that are gone."""
    for folder in path.parent.glob(f".{_escape(path.name)}.tmp-*"):
        try:
            with (folder / "lock").open("r+") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(folder, ignore_errors=True)
        except FileNotFoundError:
            with suppress(OSError):
                folder.rmdir()  # only where it is empty
        except OSError:  # its writer lives
            continue


def _escape(name: str) -> str:
    """A name as a glob pattern that matches it alone."""
    return re.sub(r"([*?[])", r"[\1]", name)


def _reason(error: Exception) -> str | None:
    """Why the system refused to write, where that is what ``error`` says; safetensors tells it in words alone."""
    if isinstance(error, InputError):
        return None
    if isinstance(error, OSError):
        return None if error.errno is None else error.strerror
    code = re.search(r"\(os error (\d+)\)", str(error))
    return None if code is None else os.strerror(int(code[1]))


@contextmanager
def lock_file(path: Path, wait_s: float = 0.0, held: str = "another process holds this lock") -> Iterator[None]:
    """Hold the lock that a file is; the kernel releases it however this process ends.

    Arguments:
        wait_s: how long to wait for another process.
        held: what it means that another one holds it, for the message.

    Raises:
        InputError: another process holds it, and did so for ``wait_s``; or the file cannot be made.
    """
    from filelock import FileLock, Timeout  # 50 ms, which few commands need

    lock = FileLock(path, fallback_to_soft=False)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(timeout=min(wait_s, TOLD_S))
        except Timeout:
            if wait_s <= TOLD_S:
                raise
            logger.info("%s: another process holds this lock; waiting for it, up to %.0f s", path, wait_s)
            lock.acquire(timeout=wait_s - TOLD_S)
    except Timeout as error:
        problem = f"another process has held this lock for {wait_s:.0f} s" if wait_s else held
        raise InputError(path, problem, "stop that process, or wait for it and try again") from error
    except OSError as error:
        raise InputError(path, f"cannot be written ({error.strerror})", "choose a writable results folder") from error
    try:
        yield
    finally:
        lock.release()


def is_inside(path: str | Path, folder: str | Path) -> bool:
    """Whether a path truly lies in a folder, wherever links and ``..`` lead."""
    return Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def check_inside(path: Path, folder: str | Path) -> Path:
    """A path that truly lies in a folder, which may be a stranger's.

    Raises:
        InputError: a link or ``..`` leads out of it.
    """
    if not is_inside(path, folder):
        raise InputError(path, f"leads out of {folder}", "put the file itself there")
    return path


def find(folder: str | Path, pattern: str) -> list[Path]:
    """Files anywhere below a folder, sorted, but for those that a link brings there from outside."""
    return [path for path in sorted(Path(folder).rglob(pattern)) if path.is_file() and is_inside(path, folder)]


def write_text(path: str | Path, text: str) -> None:
    """Write ``text`` to ``path`` atomically."""
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: str | Path, value: object) -> None:
    """Write ``value`` as indented JSON to ``path`` atomically; NaN and infinities are refused."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def read_json(path: str | Path) -> object:
    """Read a JSON file.

    Raises:
        InputError: the file cannot be read or is not JSON.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "run the stage that makes it") from error
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "give the path of a JSON file") from error
    except (ValueError, RecursionError) as error:
        raise InputError(path, f"not JSON ({error})", "make it again") from error


def read_npz(
    path: str | Path, kind: str, remedy: str, names: Collection[str] | None = None, optional: Collection[str] = ()
) -> dict[str, np.ndarray]:
    """Read arrays of numbers and texts from an npz.

    What the file claims is checked before memory is taken for it: an array of zeros of any size fits into a few bytes.

    Arguments:
        kind: what the file should be, for messages.
        remedy: the stage to run where the file is missing or damaged, for messages.
        names: the arrays to read; None: all.
        optional: those to read besides where the file has them.

    Raises:
        InputError: the file is missing, is no npz or lacks an array; an array holds neither numbers nor texts, has
            another size than it claims, or is larger than memory.
    """
    import numpy as np

    try:
        with zipfile.ZipFile(path) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            wanted = list(members if names is None else names)
            if missing := [name for name in wanted if name not in members]:
                raise InputError(path, f"no array {missing[0]!r}", remedy)
            wanted += [name for name in optional if name in members and name not in wanted]
            left = _memory()
            for name in wanted:
                left -= members[name].file_size
                _check_array(archive, members[name], left)
            sizes, packed = (sum(getattr(members[n], key) for n in wanted) for key in ("file_size", "compress_size"))
            _check_ratio("what it holds", sizes, packed)
            arrays = {}
            for name in wanted:
                with archive.open(members[name]) as stream:
                    arrays[name] = np.lib.format.read_array(stream, allow_pickle=False)
    except InputError:
        raise
    except FileNotFoundError as error:
        raise InputError(path, "no such file", remedy) from error
    except Exception as error:  # zipfile, zlib and numpy raise a dozen kinds; what the file lacks is the same
        raise InputError(path, f"not a {kind} ({error})", remedy) from error
    return arrays


def _check_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, left: int) -> None:
    """Compare what an array's header claims with the member's size, and that with what the machine has.

    Raises:
        ValueError: they do not fit, or the array holds neither numbers nor texts.
    """
    shape, dtype, header = _npy_header(archive, member)
    size = header + math.prod(shape) * dtype.itemsize
    name = member.filename
    if dtype.kind not in "biufUS":
        raise ValueError(f"{name} holds {dtype}")
    if size != member.file_size or any(length < 0 for length in shape):
        raise ValueError(f"{name} has {member.file_size} bytes, and claims {size}")
    _check_ratio(name, size, member.compress_size)
    if left < 0:
        raise ValueError(f"{name} and what is read with it need more memory than there is")


def _check_ratio(name: str, size: int, packed: int) -> None:
    """Refuse what claims far more bytes than measured data would for as many packed ones.

    Raises:
        ValueError: it does.
    """
    if size > UNSUSPECTED and size > RATIO * packed:
        raise ValueError(f"{name} claims {size / 1e9:.1f} GB in {packed / 1e6:.1f} MB")


def npz_headers(path: str | Path) -> dict[str, tuple[tuple[int, ...], np.dtype]]:
    """Shape and type of each array of an npz, by name, without its numbers; empty for any other file."""
    if not zipfile.is_zipfile(path):
        return {}
    with zipfile.ZipFile(path) as archive:
        return {m.filename.removesuffix(".npy"): _npy_header(archive, m)[:2] for m in archive.infolist()}


def _npy_header(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> tuple[tuple[int, ...], np.dtype, int]:
    """Shape and type that an array's header claims, and the header's length in bytes."""
    from numpy.lib import format as npy

    with archive.open(member) as stream:
        read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}[npy.read_magic(stream)]
        shape, _, dtype = read(stream)
        return shape, dtype, stream.tell()


def _memory() -> int:
    """Half of what may be taken, in bytes: what is read is converted, which takes as much again."""
    return memory_limit() // 2


def memory_limit(groups: Path = Path("/proc/self/cgroup"), tree: Path = Path("/sys/fs/cgroup")) -> int:
    """Memory in bytes that this process may take: the machine's, or less where its container or its job has less.

    Arguments:
        groups: the process's control groups, as Linux lists them, a line each: number, controllers, path.
        tree: where their limits lie.
    """
    limit = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with suppress(OSError):
        for line in groups.read_text(encoding="utf-8").splitlines():
            _, controllers, path = line.split(":", 2)
            root, name = (tree, "memory.max") if not controllers else (tree / "memory", "memory.limit_in_bytes")
            if controllers and "memory" not in controllers.split(","):
                continue
            group = PurePosixPath(path)
            for above in (group, *group.parents):  # within a container, its own group is the root
                with suppress(OSError, ValueError):  # a group without a limit says "max"
                    limit = min(limit, int((root / above.relative_to("/") / name).read_text(encoding="utf-8")))
    return limit


def sha256(path: str | Path) -> str:
    """SHA-256 of a file's bytes as hexadecimal text."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
