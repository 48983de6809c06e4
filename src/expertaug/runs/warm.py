"""Programs whose libraries are imported already: a job of the workflow then starts in a fraction of a second.

:func:`serve` starts one process that imports what programs take from elsewhere, and nothing of this package, and makes
small programs that stand for the real ones at the head of ``PATH``.  Each is a process of its own: a fork of that one.
Folder, environment, standard streams, arguments, signals and exit status are those of a program that is started; where
the system has no such forks, or that process is gone, the ordinary program runs.  What differs: a program's time and
memory are not those of the process that a shell started, and hashes of strings are the same in all of them.

Run as a script, this is that process: nothing but the standard library is imported when it starts.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import functools
import gc
import importlib
import json
import os
import runpy
import selectors
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from types import ModuleType
from typing import NoReturn

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
PYTHON = "python"  # stands for the interpreter, where it is among the programs
# What libraries import themselves when they are first used.
LATER = (
    "torch._dynamo",
    "mlflow.store.tracking.sqlalchemy_store",
    "matplotlib.backends.backend_pdf",
    "fontTools.subset",
)
WORTH_IT = 4  # jobs: fewer start sooner by themselves than everything is imported
_PR_SET_PDEATHSIG = 1  # of <sys/prctl.h>
# What stands for a program: it hands over what a process is started with, and ends as the fork does.
_CLIENT = """
import os, signal, socket, sys, json, array
name, main, *rest = sys.argv[1:]
mask = os.umask(0)
os.umask(mask)
fork = socket.socket(socket.AF_UNIX)
try:
    given = json.dumps([[name, main, *rest], os.getcwd(), dict(os.environ), mask]).encode("utf-8", "surrogateescape")
    streams = array.array("i", [0, 1, 2])
    fork.connect({address!r})
    fork.sendmsg([len(given).to_bytes(8, "big")], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, streams)])
    fork.sendall(given)
    pid = int.from_bytes(fork.recv(8, socket.MSG_WAITALL), "big")
except OSError:
    pid = 0
if not pid:  # nothing was forked
    start = f"import sys; sys.path[0] = {bin!r}; sys.argv[0] = {{name!r}}; from {{main}} import main; sys.exit(main())"
    os.execv(sys.executable, [sys.executable, *(["-c", start] if main else []), *rest])
def stop(number, frame):
    os.kill(pid, signal.SIGSTOP)
    os.kill(os.getpid(), signal.SIGSTOP)
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGCONT):
    if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup has it
        signal.signal(number, lambda number, frame: os.kill(pid, number))
signal.signal(signal.SIGTSTP, stop)
ended = fork.recv(8, socket.MSG_WAITALL)
status = int.from_bytes(ended, "big", signed=True) if ended else -signal.SIGKILL
if status < 0:
    signal.signal(-status, signal.SIG_DFL) if -status != signal.SIGKILL else None
    os.kill(os.getpid(), -status)
os._exit(status)
"""


@dataclass(frozen=True)
class Warm:
    """Programs that start warm, until :meth:`close` or the end of the process that asked for them.

    Attributes:
        folder: of the programs.
    """

    folder: Path
    process: subprocess.Popen

    def path(self) -> str:
        """``PATH`` with these programs first."""
        return os.pathsep.join([str(self.folder), os.environ.get("PATH", os.defpath)])

    def close(self) -> None:
        """End the process that forks, and what it forked."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        self.process.wait()


def serve(programs: Mapping[str, str], modules: Iterable[str]) -> Warm | None:
    """Have programs start warm; None where the system cannot.

    Arguments:
        programs: by name, the module whose ``main()`` each runs; ``PYTHON`` takes the interpreter's arguments.
        modules: to be imported beforehand; one that cannot be is left out.
    """
    try:
        os.close(os.pidfd_open(os.getpid()))
    except (AttributeError, OSError):
        return None
    made = Path(tempfile.mkdtemp(prefix="warm-"))
    address = str(made / "socket")
    with socket.socket(socket.AF_UNIX) as listener:
        try:
            listener.bind(address)
        except OSError:  # a path too long for a socket's
            shutil.rmtree(made)
            return None
        listener.listen(64)
        client = made / "client.py"
        client.write_text(_CLIENT.format(address=address, bin=str(Path(sys.executable).parent)), encoding="utf-8")
        for name, main in programs.items():
            words = map(quote, (sys.executable, "-IS", str(client)))
            (made / name).write_text(f'#!/bin/sh\nexec {" ".join(words)} "$0" {quote(main)} "$@"\n', encoding="utf-8")
            (made / name).chmod(0o755)
        command = [sys.executable, "-P", str(Path(__file__).resolve()), str(made), str(listener.fileno()), *modules]
        environment = os.environ | dict.fromkeys(THREADS, "1")  # a library reads them when it is loaded
        options = {"pass_fds": [listener.fileno()], "env": environment, "start_new_session": True}
        return Warm(made, subprocess.Popen(command, stdin=subprocess.PIPE, **options))


@functools.cache
def warm_jobs(count: int, main: str) -> Warm | None:
    """Have a run of so many jobs of this package find a warm ``expertaug`` on ``PATH``, where that is worth its start;
    kept until this process ends.

    Arguments:
        main: the module whose ``main()`` a job runs.
    """
    from expertaug import source_files

    modules = [*source_files.libraries(), *LATER]
    started = serve({"expertaug": main}, modules) if count >= WORTH_IT else None
    if started:
        os.environ["PATH"] = started.path()
    return started


@dataclass(frozen=True)
class _Call:
    """What a program is started with."""

    argv: list[str]
    folder: str
    environment: dict[str, str]
    mask: int
    streams: list[int]

    @classmethod
    def read(cls, client: socket.socket) -> _Call:
        head, streams, _, _ = socket.recv_fds(client, 8, 3)
        size = int.from_bytes(head, "big")
        text = client.recv(size, socket.MSG_WAITALL)
        argv, folder, environment, mask = json.loads(text)
        return cls(argv, folder, environment, mask, streams)


def _fork_for_each(made: str, listener: socket.socket, modules: Iterable[str]) -> None:
    """Fork for each call, until the process that started this one has ended; what still runs then ends too."""
    for name in modules:
        with contextlib.suppress(Exception):
            importlib.import_module(name)
    entries = _python_path()
    sys.path[:] = [entry for entry in sys.path if entry not in entries]  # each fork has its own
    gc.collect()
    gc.freeze()
    waiting = selectors.DefaultSelector()
    waiting.register(0, selectors.EVENT_READ)
    waiting.register(listener, selectors.EVENT_READ)
    while True:
        for key, _ in waiting.select():
            if key.fileobj == 0:
                for other in list(waiting.get_map().values()):
                    if other.data and other.fileobj is other.data[1]:
                        os.kill(other.data[0], signal.SIGKILL)
                shutil.rmtree(made, ignore_errors=True)
                return
            if key.fileobj is listener:
                client, _ = listener.accept()
                try:
                    call = _Call.read(client)
                except (OSError, ValueError):  # a program that was killed while it asked
                    client.close()
                    continue
                try:
                    pid = os.fork()
                except OSError:  # short of memory: the program starts by itself, or says so
                    pid = -1
                if not pid:
                    for other in list(waiting.get_map().values()):
                        if other.fd:
                            os.close(other.fd)
                    client.close()
                    _become(call)
                for stream in call.streams:
                    os.close(stream)
                if pid < 0:
                    client.close()
                    continue
                running = os.pidfd_open(pid)
                waiting.register(running, selectors.EVENT_READ, (pid, client, running))
                waiting.register(client, selectors.EVENT_READ, (pid, client, running))
                with contextlib.suppress(OSError):
                    client.sendall(pid.to_bytes(8, "big"))
            elif key.data[1].fileno() >= 0:  # a fork that has ended, or a program that was killed
                pid, client, running = key.data
                if key.fileobj is client:
                    os.kill(pid, signal.SIGKILL)
                status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
                waiting.unregister(client)
                waiting.unregister(running)
                with contextlib.suppress(OSError):
                    client.sendall(status.to_bytes(8, "big", signed=True))
                client.close()
                os.close(running)


def _become(call: _Call) -> NoReturn:
    """In the fork: run the program and end as it would."""
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    for number, stream in enumerate(call.streams):
        os.dup2(stream, number)
        os.close(stream)
    os.chdir(call.folder)
    os.umask(call.mask)
    os.environ.clear()
    os.environ.update(call.environment)
    tempfile.tempdir = None  # a library may have asked for it already
    if "numpy" in sys.modules:
        sys.modules["numpy"].random.seed()  # as a new process has it
    status = 1
    try:
        _start(call.argv)
        status = 0
    except SystemExit as end:
        status = _status_of(end)
    except KeyboardInterrupt:
        traceback.print_exc()
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
    except BaseException:
        traceback.print_exc()
    with contextlib.suppress(Exception):
        threading._shutdown()  # type: ignore[attr-defined]
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    os._exit(status & 0xFF)


def _start(argv: list[str]) -> None:
    program, main, *arguments = argv
    if main:
        _set_path(str(Path(sys.executable).parent))
        sys.argv = [program, *arguments]
        sys.exit(importlib.import_module(main).main())
    first, *rest = arguments
    if first == "-m":
        _set_path(str(Path.cwd()))
        sys.argv = rest
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
    elif first == "-c":
        _set_path("")
        sys.argv = ["-c", *rest[1:]]
        sys.modules["__main__"] = module = ModuleType("__main__")
        exec(compile(rest[0], "<string>", "exec"), module.__dict__)
    elif first.startswith("-"):
        raise ValueError(f"{first}: no warm Python takes this option; start sys.executable")
    else:
        script = Path(first)
        _set_path(str((script.resolve() if script.is_symlink() else script.absolute()).parent))
        sys.argv = [first, *rest]
        runpy.run_path(first, run_name="__main__")


def _set_path(first: str) -> None:
    """Python's path as a new process has it, and what it does first."""
    entries = _python_path()
    sys.path[:0] = [first, *entries]
    sys.path_importer_cache.clear()
    importlib.invalidate_caches()
    if entries:
        with contextlib.suppress(ImportError):
            importlib.import_module("sitecustomize")


def _python_path() -> list[str]:
    """What ``PYTHONPATH`` names, as Python has it in its path."""
    entries = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    return [str(Path(entry).absolute()) for entry in entries if entry]


def _status_of(end: SystemExit) -> int:
    if end.code is None:
        return 0
    if isinstance(end.code, int):
        return end.code
    print(end.code, file=sys.stderr)
    return 1


if __name__ == "__main__":
    _fork_for_each(sys.argv[1], socket.socket(fileno=int(sys.argv[2])), sys.argv[3:])
