"""Reading of damaged and hostile recordings: each is read soundly, or refused in one clear line.

    python benchmarks/damage.py OUTPUT [--mutations 1000000] [--seconds 600] [--seed 0] [--workers 1] [--every 1]

Named cases first (benchmarks/damaged), then random mutations until their number or the time is used up.  Each is read
in a worker process of limited memory, so that a crash or a hang is seen and counted, and the work goes on.  OUTPUT
gets cases.csv (what became of each named case), failures.csv and summary.json; exit status 1 where anything failed.

Outcomes: ``refused`` in one line; ``read`` as the sound file; ``timed``: read, with the uneven times of its frames, in
which a missing one is a gap; ``altered``: read, but not as it was, and nothing in the
file tells: only its SHA-256 does (recordings.checksums).  Anything else is a failure.
"""

from __future__ import annotations

import argparse
import csv
import json
import multiprocessing
import os
import resource
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

import cv2
import numpy as np

from damaged import damaged, mutant
from damaged.base import Case, sound
from expertaug.errors import InputError
from expertaug_recordings.ibm import import_markers, unpack_archive
from expertaug_recordings.settings import ExtractFramesJob, ImportMarkersJob, UnpackMarkersJob
from expertaug_recordings.video.frame_store import FrameStore
from expertaug_recordings.video.frame_store import run_stage as extract_frames

MEMORY_BYTES = 2**30  # that a case may take
CASE_SECONDS = 30  # on a busy machine
LINE = 1000  # characters of a message that is still one line
FAILED = ("crash", "hang", "traceback", "memory", "unclear", "accepted")
HEADER = ("case", "kind", "expected", "outcome", "message")


def read_file(case: Case, folder: Path) -> object:
    """What the product reads of a case's file, as something to compare.

    Raises:
        InputError: it refuses the file.
    """
    path = folder / f"recording{case.suffix}"
    path.write_bytes(case.data)
    if case.kind == "video":
        job = ExtractFramesJob(rate_hz=400.0 if case.suffix == ".h264" else None)
        extract_frames(path, folder / "frames.b2frame", job)
        store = FrameStore(folder / "frames.b2frame")
        return store.read(0, len(store)), store.rate_hz, store.t
    if case.kind == "markers":
        import_markers(path, folder / "markers.csv", ImportMarkersJob())
        return (folder / "markers.csv").read_bytes()
    unpacked = unpack_archive(path, folder / "unpacked", UnpackMarkersJob())
    return {name: csv.read_bytes() for name, csv in unpacked.items()}


def same(one: object, other: object) -> bool:
    if isinstance(one, tuple):
        return np.array_equal(one[0], other[0]) and one[1] == other[1] and np.allclose(one[2], other[2])
    return one == other


def judge(case: Case, truth: dict[str, object], folder: Path) -> tuple[str, str]:
    """Outcome of a case in one word, and the message or what differs."""
    try:
        found = read_file(case, folder)
    except InputError as error:
        text = str(error)
        clear = text.isprintable() and len(text) < LINE
        return ("refused", text) if clear else ("unclear", repr(text[:LINE]))
    except MemoryError:
        return "memory", f"more than {MEMORY_BYTES >> 20} MiB"
    except Exception:
        return "traceback", traceback.format_exc(limit=-3)
    if case.base and same(found, truth[case.base]):
        return "read", ""
    if case.kind == "video" and np.ptp(np.diff(found[2])) > 0.1 / found[1]:
        return "timed", _difference(found, truth[case.base])
    if case.expected == "refused" or not case.base:
        return "accepted", _difference(found, truth.get(case.base))
    return "altered", _difference(found, truth[case.base])


def _difference(found: object, truth: object) -> str:
    if not isinstance(found, tuple) or truth is None:
        return "other content"
    (images, rate, _), (expected, expected_rate, _) = found, truth
    if images.shape != expected.shape or rate != expected_rate:
        return f"{len(images)} frames of {images.shape[2]}x{images.shape[1]} px at {rate:g} Hz"
    off = np.abs(images.astype(int) - expected).max(axis=(1, 2, 3))
    return f"{(off > 0).sum()} of {len(off)} frames differ, by up to {off.max()} levels"


@dataclass
class Worker:
    """A process that judges cases in turn, and what the parent knows of it."""

    process: multiprocessing.Process
    pipe: Connection
    index: int
    since: float


def work(make: Callable[[int], Case | None], truth: dict[str, object], start: int, step: int, pipe: Connection) -> None:
    """In the worker: judge cases ``start``, ``start + step`` … until there is none."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY_BYTES,) * 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    shared = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=shared if shared.is_dir() else None) as folder:
        index, parent = start, os.getppid()
        while os.getppid() == parent and (case := make(index)) is not None:
            outcome, message = judge(case, truth, Path(folder))
            pipe.send((index, case.name, case.kind, case.expected, outcome, message))
            index += step


def judge_all(
    make: Callable[[int], Case | None], truth: dict[str, object], workers: int, seconds: float
) -> list[tuple[str, ...]]:
    """Rows (case, kind, expected, outcome, message) of every case that ``make`` gives, until the time is used up."""
    fork = multiprocessing.get_context("fork")

    def begin(index: int) -> Worker:
        ours, theirs = fork.Pipe(duplex=False)
        process = fork.Process(target=work, args=(make, truth, index, workers, theirs), daemon=True)
        process.start()
        theirs.close()
        return Worker(process, ours, index, time.monotonic())

    rows, end = [], time.monotonic() + seconds
    running = [begin(k) for k in range(workers)]
    while running and time.monotonic() < end:
        told = wait([worker.pipe for worker in running], timeout=0.05)
        for worker in list(running):
            ended = False
            try:
                if worker.pipe in told:
                    index, *row = worker.pipe.recv()
                    rows.append(tuple(row))
                    worker.index, worker.since = index + workers, time.monotonic()
            except EOFError:  # all that it told has been read
                worker.process.join()
                ended = True
            late = time.monotonic() - worker.since > CASE_SECONDS
            if not ended and not late:
                continue
            running.remove(worker)
            if worker.process.exitcode == 0:
                continue
            worker.process.kill()
            worker.process.join()
            case = make(worker.index)
            outcome = ("hang", f"{CASE_SECONDS} s") if late else ("crash", f"exit status {worker.process.exitcode}")
            rows.append((case.name, case.kind, case.expected, *outcome))
            running.append(begin(worker.index + workers))
    for worker in running:
        worker.process.kill()
        worker.process.join()
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("output", type=Path)
    parser.add_argument("--mutations", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=600.0, help="for the mutations")
    parser.add_argument("--every", type=int, default=1, help="take one in so many of the cut and overwritten files")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(1)  # a fork of OpenCV's threads would wait for them
    with tempfile.TemporaryDirectory() as folder:
        bases = sound(Path(folder))
        truth = {name: read_file(base, Path(folder)) for name, base in bases.items()}
    cases = list(damaged(bases, options.seed, options.every))
    start = time.monotonic()
    named = judge_all(lambda k: cases[k] if k < len(cases) else None, truth, options.workers, 3600)
    print(f"{len(named)} named cases in {time.monotonic() - start:.0f} s")
    start = time.monotonic()

    def make(index: int) -> Case | None:
        return mutant(bases, options.seed, index) if index < options.mutations else None

    random = judge_all(make, truth, options.workers, options.seconds)
    seconds = time.monotonic() - start
    print(f"{len(random)} mutations in {seconds:.0f} s")
    failures = [row for row in named + random if row[3] in FAILED]
    options.output.mkdir(parents=True, exist_ok=True)
    for name, rows in (("cases", named), ("failures", failures)):
        with (options.output / f"{name}.csv").open("w", newline="", encoding="utf-8") as stream:
            csv.writer(stream).writerows([HEADER, *rows])
    summary = {
        "seed": options.seed,
        "named": _counts(named),
        "mutations": _counts(random),
        "mutation_seconds": round(seconds),
        "failures": len(failures),
    }
    (options.output / "summary.json").write_text(json.dumps(summary, indent=2) + "\n")
    print(json.dumps(summary, indent=2))
    return 1 if failures or len(named) < len(cases) else 0


def _counts(rows: list[tuple[str, ...]]) -> dict[str, dict[str, int]]:
    """Number of cases by kind and outcome."""
    counts = Counter((row[1], row[3]) for row in rows)
    kinds = sorted({kind for kind, _ in counts})
    return {kind: {outcome: n for (k, outcome), n in sorted(counts.items()) if k == kind} for kind in kinds}


if __name__ == "__main__":
    sys.exit(main())
