"""Python whose libraries are imported already, for tests of what a command does: seconds less for each command.

``interpreter()`` takes the place of ``sys.executable``, and ``path()`` that of ``PATH``, so that ``python``,
``expertaug`` and ``snakemake`` that a command starts are warm too.  Each is a process of its own: a fork of one that
has imported what the package takes from elsewhere, and nothing of the package.  Folder, environment, standard streams,
arguments, signals and exit status are those of a program that is started.  What differs: no ``sitecustomize`` is read,
a program's time and memory are not those of the process that a shell started, and hashes of strings are the same in all
of them.  So tests of imports, of start-up, of killed runs and of determinism start ``sys.executable``.

Run as a script, this is that process (``serve``).
"""

from __future__ import annotations

import ast
import atexit
import contextlib
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
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

SOURCE = Path(__file__).resolve().parents[1] / "src"
PROGRAMS = {"expertaug": "expertaug.cli", "snakemake": "snakemake.cli"}  # where each has its main()
FORWARDED = ("SIGINT", "SIGTERM", "SIGHUP")
# What stands for a program: it hands over what a process is started with, and ends as the fork does.
CLIENT = """#!{python} -IS
import os, signal, socket, sys, json, array
fork = socket.socket(socket.AF_UNIX)
fork.connect({address!r})
mask = os.umask(0)
given = json.dumps([sys.argv, os.getcwd(), dict(os.environ), mask]).encode("utf-8", "surrogateescape")
streams = array.array("i", [0, 1, 2])
fork.sendmsg([len(given).to_bytes(8, "big")], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, streams)])
fork.sendall(given)
pid = int.from_bytes(fork.recv(8, socket.MSG_WAITALL), "big")
for name in {signals!r}:
    signal.signal(getattr(signal, name), lambda number, frame: os.kill(pid, number))
ended = fork.recv(8, socket.MSG_WAITALL)
status = int.from_bytes(ended, "big", signed=True) if ended else 1
if status < 0:
    signal.signal(-status, signal.SIG_DFL) if -status != signal.SIGKILL else None
    os.kill(os.getpid(), -status)
os._exit(status)
"""


def interpreter() -> str:
    """The warm ``python``; where the system has no such forks, the ordinary one."""
    return str(Path(folder) / "python") if (folder := _folder()) else sys.executable


def path() -> str:
    """``PATH`` with the warm programs first, and those beside the ordinary Python next."""
    return os.pathsep.join(filter(None, (_folder(), str(Path(sys.executable).parent), os.environ["PATH"])))


@functools.cache
def _folder() -> str:
    """The folder of the programs, "" where there are none; the process that forks ends with this one."""
    if not hasattr(os, "pidfd_open"):
        return ""
    made = tempfile.mkdtemp(prefix="warm-")
    address = str(Path(made) / "socket")
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(address)
    listener.listen(64)
    listener.set_inheritable(True)
    command = [sys.executable, "-I", str(Path(__file__).resolve()), made, str(listener.fileno())]
    subprocess.Popen(command, stdin=subprocess.PIPE, pass_fds=[listener.fileno()], cwd="/", start_new_session=True)
    listener.close()
    text = CLIENT.format(python=sys.executable, address=address, signals=FORWARDED)
    for name in ("python", *PROGRAMS):
        program = Path(made) / name
        program.write_text(text)
        program.chmod(0o755)
    return made


@dataclass(frozen=True)
class Call:
    """What a program is started with."""

    argv: list[str]
    folder: str
    environment: dict[str, str]
    mask: int
    streams: list[int]

    @classmethod
    def read(cls, client: socket.socket) -> Call:
        head, streams, _, _ = socket.recv_fds(client, 8, 3)
        size = int.from_bytes(head, "big")
        text = client.recv(size, socket.MSG_WAITALL)
        return cls(*json.loads(text), streams)


def serve(made: str, listener: socket.socket) -> None:
    """Fork for each call, until the process that started this one has ended."""
    for name in sorted(libraries(SOURCE)):
        with contextlib.suppress(Exception):
            importlib.import_module(name)
    gc.collect()
    gc.freeze()
    waiting = selectors.DefaultSelector()
    waiting.register(0, selectors.EVENT_READ)
    waiting.register(listener, selectors.EVENT_READ)
    while True:
        for key, _ in waiting.select():
            if key.fileobj == 0:
                shutil.rmtree(made, ignore_errors=True)
                return
            if key.fileobj is listener:
                client, _ = listener.accept()
                call = Call.read(client)
                if not (pid := os.fork()):
                    for other in list(waiting.get_map().values()):
                        if other.fd:
                            os.close(other.fd)
                    client.close()
                    become(call)
                for stream in call.streams:
                    os.close(stream)
                client.sendall(pid.to_bytes(8, "big"))
                running = os.pidfd_open(pid)
                waiting.register(running, selectors.EVENT_READ, (pid, client, running))
                waiting.register(client, selectors.EVENT_READ, (pid, client, running))
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


def libraries(source: Path) -> set[str]:
    """What the modules in a folder import from elsewhere, wherever they do, and Snakemake's command line."""
    names = {"snakemake.cli", "snakemake.api"}
    for module in source.rglob("*.py"):
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {name.name for name in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names |= {node.module, *(f"{node.module}.{name.name}" for name in node.names)}
    own = {path.stem for path in source.iterdir()}
    return {name for name in names if name.partition(".")[0] not in own}


def become(call: Call) -> None:
    """In the fork: run the program and end as it would."""
    for number, stream in enumerate(call.streams):
        os.dup2(stream, number)
        os.close(stream)
    os.chdir(call.folder)
    os.umask(call.mask)
    os.environ.clear()
    os.environ.update(call.environment)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if "numpy" in sys.modules:
        sys.modules["numpy"].random.seed()  # as a new process has it
    status = 1
    try:
        start(call.argv)
        status = 0
    except SystemExit as end:
        status = status_of(end)
    except KeyboardInterrupt:
        traceback.print_exc()
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)
    except BaseException:
        traceback.print_exc()
    with contextlib.suppress(Exception):
        threading._shutdown()
        atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    os._exit(status & 0xFF)


def start(argv: list[str]) -> None:
    program, *arguments = argv
    name = Path(program).name
    if name in PROGRAMS:
        set_path(str(Path(program).parent))
        sys.argv = [program, *arguments]
        sys.exit(importlib.import_module(PROGRAMS[name]).main())
    first, *rest = arguments
    if first == "-m":
        set_path(str(Path.cwd()))
        sys.argv = rest
        runpy.run_module(rest[0], run_name="__main__", alter_sys=True)
    elif first == "-c":
        set_path("")
        sys.argv = ["-c", *rest[1:]]
        sys.modules["__main__"] = module = ModuleType("__main__")
        exec(compile(rest[0], "<string>", "exec"), module.__dict__)
    elif first.startswith("-"):
        raise ValueError(f"{first}: no warm Python takes this option; start sys.executable")
    else:
        script = Path(first)
        set_path(str((script.resolve() if script.is_symlink() else script.absolute()).parent))
        sys.argv = [first, *rest]
        runpy.run_path(first, run_name="__main__")


def set_path(first: str) -> None:
    """Python's path as a new process has it."""
    told = [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    sys.path[:0] = [first, *(str(Path(entry).absolute()) for entry in told)]
    sys.path_importer_cache.clear()
    importlib.invalidate_caches()


def status_of(end: SystemExit) -> int:
    if end.code is None:
        return 0
    if isinstance(end.code, int):
        return end.code
    print(end.code, file=sys.stderr)
    return 1


if __name__ == "__main__":
    serve(sys.argv[1], socket.socket(fileno=int(sys.argv[2])))
