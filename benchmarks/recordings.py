"""Speed and memory of extraction and tracking, stage by stage as the workflow runs them, two jobs at a time.

    python benchmarks/recordings.py [FRAMES] [--rate 400] [--jobs 2] [--all]

Renders a recording of FRAMES frames (default 2000) and one four times as long, and runs ``expertaug extract-frames``
and ``track-markers`` on each, in as many processes at a time as the workflow would.  A job takes a constant time, to
start, and a time per frame: both follow from the two lengths, and with them what IBM's 21 recordings of 378,099 frames
would take.  Processor time decides, for others may use the machine as well; with a core for each job the clock shows
the same.

With ``--all`` nothing is extrapolated: one recording of a 21st of those frames is rendered, extracted and tracked
21 times over, ``--jobs`` of them at a time, and the clock decides.  The machine should have nothing else to do.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
CLI = [sys.executable, "-m", "expertaug.cli"]
RECORDINGS, FRAMES = 21, 378_099
RATE_HZ, TIMES = 400, 4
LIMIT_S = 300


@dataclass(frozen=True)
class Usage:
    """Of one process: its processor time and the clock's, in s, and the most memory it held, in MB."""

    processor: float
    clock: float
    memory: float


def run_together(commands: list[list[str]]) -> list[Usage]:
    """Run commands at the same time.

    A process's peak memory includes what its parent held when it was started: this script loads no library.
    """
    start = time.monotonic()
    running = {subprocess.Popen(command, stderr=subprocess.DEVNULL).pid for command in commands}
    usages = []
    while running:
        pid, status, used = os.wait4(-1, 0)
        running.discard(pid)
        if status:
            sys.exit(f"a stage failed: {commands[0]}")
        usages.append(Usage(used.ru_utime + used.ru_stime, time.monotonic() - start, used.ru_maxrss / 1024))
    return usages


def commands(folder: Path, copy: int, rate: float) -> dict[str, list[str]]:
    """The stages' commands that read a folder's video and write the files of one copy."""
    store, markers = folder / f"frames{copy}.b2frame", folder / f"markers{copy}.csv"
    extraction = json.dumps({"analysis_rate_hz": rate})
    return {
        "extract-frames": [
            *(*CLI, "extract-frames", str(folder / "video.mp4")),
            *("--output", str(store), "--settings", extraction),
        ],
        "track-markers": [*CLI, "track-markers", str(store), "--output", str(markers), "--settings", "{}"],
    }


def stages(folder: Path, jobs: int, rate: float) -> dict[str, list[Usage]]:
    """Usage of each stage on ``jobs`` copies of a folder's video at a time."""
    each = [commands(folder, copy, rate) for copy in range(jobs)]
    return {name: run_together([one[name] for one in each]) for name in each[0]}


def render(folder: Path, frames: int, room: int) -> None:
    """Render a folder's video; ``room`` is the number of frames that its stores will hold at a time."""
    if shutil.disk_usage(folder).free < room * 60_000:
        sys.exit(f"{folder}: too little space for the frame stores")
    settings = json.dumps({"duration_s": frames / RATE_HZ, "rate_hz": RATE_HZ})
    files = ["--output", str(folder / "video.mp4"), "--truth", str(folder / "truth.csv")]
    run_together([[*CLI, "render-video", "--index", "0", *files, "--settings", settings]])


def everything(jobs: int, rate: float) -> float:
    """Seconds by the clock for all of the recordings, each extracted and then tracked, ``jobs`` at a time."""

    def one(copy: int) -> None:
        for command in commands(folder, copy, rate).values():
            subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        (folder / f"frames{copy}.b2frame").unlink()

    frames = -(-FRAMES // RECORDINGS)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        render(folder, frames, jobs * frames)
        start = time.monotonic()
        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(one, range(RECORDINGS)))
        return time.monotonic() - start


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("frames", type=int, nargs="?", default=2000)
    parser.add_argument("--rate", type=float, default=400.0, help="analysis rate in Hz")
    parser.add_argument("--jobs", type=int, default=2, help="processes at a time")
    parser.add_argument("--all", action="store_true", help="all recordings, by the clock")
    options = parser.parse_args()
    if options.all:
        total = everything(options.jobs, options.rate)
        print(
            f"{RECORDINGS} recordings of {FRAMES} frames in all at {options.rate:g} Hz, {options.jobs} jobs at a time:"
            f" {total:.0f} s by the clock, {'under' if total < LIMIT_S else 'over'} five minutes"
        )
        return 0 if total < LIMIT_S else 1
    lengths = (options.frames, TIMES * options.frames)
    found = []
    for frames in lengths:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            render(folder, frames, options.jobs * frames)
            found.append(stages(folder, options.jobs, options.rate))
    print(
        f"{options.jobs} processes at a time, {lengths[0]} and {lengths[1]} frames of 480x480 px, {options.rate:g} Hz"
    )
    total = 0.0
    for stage in found[0]:
        memory = [max(used.memory for used in one[stage]) for one in found]
        times = [sum(used.processor for used in one[stage]) / options.jobs for one in found]
        per_frame = (times[1] - times[0]) / (lengths[1] - lengths[0])
        start = max(0.0, times[0] - per_frame * lengths[0])
        total += (RECORDINGS * start + FRAMES * per_frame) / options.jobs
        clock = max(used.clock for used in found[1][stage])
        print(
            f"{stage}: {start:.1f} s to start, then {1 / per_frame:.0f} frames/s of processor time a process; the"
            f" longer recordings took {clock:.0f} s by the clock; peak memory {memory[0]:.0f} MB, and"
            f" {memory[1]:.0f} MB for {TIMES} times the length"
        )
    print(
        f"extrapolated to {RECORDINGS} recordings of {FRAMES} frames in all: {total:.0f} s on {options.jobs} free"
        f" cores, {'under' if total < LIMIT_S else 'over'} five minutes (this machine's load: {os.getloadavg()[0]:.1f})"
    )
    return 0 if total < LIMIT_S else 1


if __name__ == "__main__":
    sys.exit(main())
