"""Writing: no reader sees half a file, a full disk is one line. Reading: what a file claims is not believed."""

import errno
import os
import resource
import subprocess
import sys
import tracemalloc
import zipfile
from contextlib import contextmanager

import numpy as np
import pytest
import torch
from safetensors import SafetensorError

from expertaug.errors import InputError
from expertaug.evaluation.forecasts import Forecasts
from expertaug.files import atomic, memory_limit, read_json, read_npz, write_json, write_text
from expertaug.learning.job import Checkpoint
from expertaug.models.tensor_file import write_tensors
from expertaug.trajectories import Trajectories


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, code):
    write_text(tmp_path / "a.txt", "old")

    def full(_):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("expertaug.files.os.fsync", full)
    with pytest.raises(InputError, match=r"a\.txt: cannot be written.*free some space"):
        write_text(tmp_path / "a.txt", "new")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "results").write_text("a file where the folder should be")
    with pytest.raises(InputError, match=r"cannot be written.*choose a writable results folder"):
        write_text(tmp_path / "results" / "a.txt", "text")


def test_a_failing_block_leaves_nothing(tmp_path):
    with pytest.raises(KeyError), atomic(tmp_path / "a.npz") as temporary:
        temporary.write_text("half")
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_json_round_trip_and_refusals(tmp_path):
    write_json(tmp_path / "a.json", {"x": [1, 2.5, None]})
    assert read_json(tmp_path / "a.json") == {"x": [1, 2.5, None]}
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "b.json", float("nan"))
    (tmp_path / "c.json").write_text("{")
    with pytest.raises(InputError, match="not JSON"):
        read_json(tmp_path / "c.json")
    with pytest.raises(InputError, match="no such file"):
        read_json(tmp_path / "d.json")
    with pytest.raises(InputError, match=r"cannot be read \(Is a directory\)"):
        read_json(tmp_path)
    (tmp_path / "e.json").write_text("[" * 100_000)
    with pytest.raises(InputError, match="not JSON"):
        read_json(tmp_path / "e.json")


def test_what_a_killed_writer_left_is_removed_by_the_next(tmp_path):
    code = f"""if True:
        import os, signal
        from expertaug.files import atomic
        with atomic({str(tmp_path / "a[1].mp4")!r}) as temporary:
            temporary.write_text("half")
            (temporary.parent / "beside").touch()
            os.kill(os.getpid(), signal.SIGKILL)
    """
    subprocess.run([sys.executable, "-c", code])
    (tmp_path / ".a[1].mp4.tmp-unlocked").mkdir()  # killed before it took its lock
    (tmp_path / ".a[1].mp4.notes").touch()
    assert len(list(tmp_path.iterdir())) == 3
    write_text(tmp_path / "a1.mp4", "a file whose name the first one's would match as a pattern")
    assert len(list(tmp_path.iterdir())) == 4
    write_text(tmp_path / "a[1].mp4", "whole")
    assert {path.name for path in tmp_path.iterdir()} == {"a[1].mp4", "a1.mp4", ".a[1].mp4.notes"}


def test_writers_of_one_file_at_once_leave_each_other_alone(tmp_path):
    with atomic(tmp_path / "a.txt") as first:
        first.write_text("first")
        first.unlink()  # some libraries make the file anew
        first.write_text("first")
        with atomic(tmp_path / "a.txt") as second:
            second.write_text("second")
            assert first != second and first.suffix == second.suffix == ".txt"
        assert (tmp_path / "a.txt").read_text() == "second"
    assert (tmp_path / "a.txt").read_text() == "first"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


@pytest.fixture
def full_disk():
    """A limit on the size of files, which the libraries meet as they meet a full disk, and which needs no root."""
    old = resource.getrlimit(resource.RLIMIT_FSIZE)

    @contextmanager
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, old[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, old)

    return limit()


@pytest.mark.parametrize("write", ["checkpoint", "model", "trajectories"])
def test_whatever_library_writes_a_full_disk_is_one_line(tmp_path, full_disk, write):
    values = torch.rand(4, 50, 50)
    writers = {
        "checkpoint": lambda: Checkpoint(tmp_path, "f").save({"values": values}),
        "model": lambda: write_tensors(tmp_path / "a", torch.nn.Linear(100, 100).state_dict(), {}),
        "trajectories": lambda: Trajectories(np.arange(50), values.numpy(), np.zeros((4, 1))).save(tmp_path / "a"),
    }
    with full_disk, pytest.raises(InputError, match=r"cannot be written \(File too large\); free some space"):
        writers[write]()
    assert list(tmp_path.iterdir()) == []


def test_no_space_in_the_words_of_safetensors(tmp_path):
    with pytest.raises(InputError, match=r"cannot be written \(No space left on device\)"), atomic(tmp_path / "a"):
        raise SafetensorError("Error while serializing: I/O error: No space left on device (os error 28)")


def npy(header: str, data: bytes = b"", version: int = 1) -> bytes:
    text = header.encode() + b"\n"
    return b"\x93NUMPY" + bytes([version, 0]) + len(text).to_bytes(2 if version == 1 else 4, "little") + text + data


def described(dtype: str = "'<f4'", shape: str = "(3,)") -> str:
    return f"{{'descr': {dtype}, 'fortran_order': False, 'shape': {shape}}}"


HOSTILE = {
    "structured": npy(described("[('a', '<f4'), ('b', 'O')]"), bytes(36)),
    "objects": npy(described("'|O'"), bytes(12)),
    "dates": npy(described("'<M8[s]'"), bytes(24)),
    "huge shape": npy(described(shape=f"({10**40},)"), bytes(12)),
    "negative shape": npy(described(shape="(-3,)"), bytes(12)),
    "shape is text": npy(described(shape="'abc'"), bytes(12)),
    "no such dtype": npy(described("'<f3'"), bytes(12)),
    "too short": npy(described(), bytes(8)),
    "too long": npy(described(), bytes(16)),
    "no dictionary": npy("1 + 1", bytes(12)),
    "deep": npy("[" * 9000, bytes(12)),
    "of version 9": npy(described(), bytes(12), version=9),
    "not npy": b"hello",
    "nothing": b"",
}


@pytest.mark.parametrize("content", HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_array_is_one_line(tmp_path, content):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("x.npy", content)
        for name in ("t", "y", "z_e", "z_a"):
            archive.writestr(f"{name}.npy", content)
    with pytest.raises(InputError, match=r"a\.npz: not a set of arrays \("):
        read_npz(tmp_path / "a.npz", "set of arrays", "make it again", ["x"])
    for load in (Trajectories.load, Forecasts.load):
        with pytest.raises(InputError, match=r"a\.npz: "):
            load(tmp_path / "a.npz")


def test_a_bomb_of_zeros_is_refused_before_memory_is_taken(tmp_path):
    header, size = npy(described(shape=f"({2**25},)")), 4 * 2**25
    with (
        zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("x.npy", "w", force_zip64=True) as stream,
    ):
        stream.write(header)
        for _ in range(size // 2**20):
            stream.write(bytes(2**20))
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match=r"x\.npy claims 0\.1 GB in 0\.1 MB"):
            read_npz(tmp_path / "a.npz", "set of arrays", "make it again")
        assert tracemalloc.get_traced_memory()[1] < 2**24
    finally:
        tracemalloc.stop()


def test_a_bomb_of_many_small_arrays_is_refused(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", **{f"x{k}": np.zeros(2**20, np.uint8) for k in range(65)})
    with pytest.raises(InputError, match=r"what it holds claims 0\.1 GB in 0\.1 MB"):
        read_npz(tmp_path / "a.npz", "set of arrays", "make it again")


@pytest.mark.parametrize(
    ("line", "limits", "expected"),
    [
        ("0::/job/step", {"job/memory.max": "4096", "job/step/memory.max": "max"}, 4096),
        ("0::/", {"memory.max": "8192"}, 8192),
        ("5:cpu,memory:/docker/x", {"memory/memory.limit_in_bytes": "2048", "memory/docker/x/y": "1"}, 2048),
        ("5:cpu:/docker/x", {"memory.max": "1"}, None),
        ("0::/job", {}, None),
    ],
)
def test_a_container_or_a_job_may_have_less_memory_than_the_machine(tmp_path, line, limits, expected):
    (tmp_path / "cgroup").write_text(f"{line}\n")
    for name, text in limits.items():
        (tmp_path / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "tree" / name).write_text(f"{text}\n")
    machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert memory_limit(tmp_path / "cgroup", tmp_path / "tree") == (expected or machine)


def test_arrays_that_together_need_more_than_memory_are_refused(tmp_path, monkeypatch):
    np.savez(tmp_path / "a.npz", x=np.zeros(1000), y=np.zeros(1000))
    monkeypatch.setattr("expertaug.files._memory", lambda: 10_000)
    assert list(read_npz(tmp_path / "a.npz", "set of arrays", "make it again", ["x"])) == ["x"]
    with pytest.raises(InputError, match="more memory than there is"):
        read_npz(tmp_path / "a.npz", "set of arrays", "make it again")


def test_arrays_are_read_as_they_were_written(tmp_path):
    written = {"x": np.arange(6.0).reshape(2, 3), "n": np.array(5), "names": np.array(["a", "θ"])}
    written["f"] = np.zeros((0, 2))
    np.savez_compressed(tmp_path / "a.npz", **written)
    found = read_npz(tmp_path / "a.npz", "set of arrays", "make it again", ["x"], optional=["names", "n", "f", "none"])
    assert found.keys() == written.keys()
    assert all(np.array_equal(found[k], v) and found[k].dtype == v.dtype for k, v in written.items())
    with pytest.raises(InputError, match="no array 'none'; make it again"):
        read_npz(tmp_path / "a.npz", "set of arrays", "make it again", ["none"])


def test_a_file_of_other_arrays_names_itself(tmp_path):
    np.savez(tmp_path / "a.npz", t=["x"], y=np.float32(3), z_e=np.zeros(2), z_a=np.zeros(2))
    with pytest.raises(InputError, match=r"a\.npz: not a trajectory file"):
        Trajectories.load(tmp_path / "a.npz")
    names = ("seeds", "state_names", "state_units", "parameter_names", "parameter_units")
    np.savez(tmp_path / "b.npz", t=3.0, observed=[1, 2], **dict.fromkeys(names, 1))
    with pytest.raises(InputError, match=r"b\.npz: not a forecast file"):
        Forecasts.load(tmp_path / "b.npz")
