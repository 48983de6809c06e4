"""A warm Python does what the ordinary one does, sooner."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest

import warm_python
from expertaug.runs import warm

CODES = {
    "standard streams": "import sys; print(sys.stdin.read(), end=''); print('said', file=sys.stderr)",
    "arguments": "import sys; print(sys.argv)",
    "folder, variables, mask": "import os; print(os.getcwd(), os.environ['SAID'], len(os.environ), os.umask(0))",
    "path": "import sys; print([entry for entry in sys.path if 'here' in entry])",
    "a status": "import sys; sys.exit(7)",
    "a reason": "import sys; sys.exit('no')",
    "a signal": "import os, signal; os.kill(os.getpid(), signal.SIGTERM)",
    "an interrupt": "raise KeyboardInterrupt",
    "what is done last": "import atexit; atexit.register(print, 'last'); print('first')",
    "threads": "import threading; threading.Timer(0.1, print, ['late']).start()",
}


def run(python: str, folder, *words: str) -> subprocess.CompletedProcess:
    env = os.environ | {"SAID": "yes", "PYTHONPATH": "here"}
    return subprocess.run([python, *words], cwd=folder, env=env, input="in\n", capture_output=True, text=True)


def ended(done: subprocess.CompletedProcess) -> tuple:
    return done.returncode, done.stdout, done.stderr if "Traceback" not in done.stderr else "Traceback"


@pytest.mark.parametrize("code", CODES.values(), ids=CODES)
def test_a_program_sees_and_says_the_same(code, tmp_path):
    expected = run(sys.executable, tmp_path, "-c", code, "a", "b")
    assert ended(run(warm_python.interpreter(), tmp_path, "-c", code, "a", "b")) == ended(expected)


def test_modules_and_scripts_are_started_alike(tmp_path):
    (tmp_path / "program.py").write_text("import sys, other; print(__name__, __file__, sys.argv, other.__name__)")
    (tmp_path / "other.py").touch()
    for words in (("-m", "program", "a"), (str(tmp_path / "program.py"), "a")):
        expected = run(sys.executable, tmp_path, *words)
        assert expected.returncode == 0
        assert ended(run(warm_python.interpreter(), tmp_path, *words)) == ended(expected)


def test_libraries_are_there_and_nothing_of_the_package(tmp_path):
    code = "import sys, json; print(json.dumps(list(sys.modules)))"
    names = set(json.loads(run(warm_python.interpreter(), tmp_path, "-c", code).stdout))
    assert {"torch", "pandas", "snakemake.cli"} <= names or warm_python.interpreter() == sys.executable
    assert not [name for name in names if name.startswith("expertaug")]


def test_what_is_killed_does_not_go_on(tmp_path):
    code = "import time, os; print(os.getpid(), flush=True); time.sleep(60)"
    running = subprocess.Popen([warm_python.interpreter(), "-c", code], stdout=subprocess.PIPE, text=True)
    pid = int(running.stdout.readline())
    os.kill(pid, 0)
    running.kill()
    assert running.wait() == -signal.SIGKILL
    running.stdout.close()
    until = time.monotonic() + 60
    with pytest.raises(ProcessLookupError):
        while time.monotonic() < until:
            os.kill(pid, 0)
            time.sleep(0.02)


def test_where_nothing_forks_any_more_the_ordinary_program_runs(tmp_path):
    started = warm.serve({warm.PYTHON: "", "platform": "mine"}, [])
    if started is None:
        pytest.skip("this system has no such forks")
    (tmp_path / "mine.py").write_text("import sys\ndef main(): print(sys.argv[1:]); return 5\n")
    env = os.environ | {"PYTHONPATH": str(tmp_path)}

    def said(program: str, *words: str) -> tuple:
        done = subprocess.run([started.folder / program, *words], env=env, capture_output=True, text=True)
        return done.returncode, done.stdout, done.stderr

    before = said("platform", "a", "b c"), said(warm.PYTHON, "-c", "print(1)")
    assert before == ((5, "['a', 'b c']\n", ""), (0, "1\n", ""))
    started.process.kill()
    started.process.wait()
    assert (said("platform", "a", "b c"), said(warm.PYTHON, "-c", "print(1)")) == before
    shutil.rmtree(started.folder)


def test_a_run_that_ends_takes_its_jobs_with_it_and_leaves_nothing(tmp_path):
    started = warm.serve({warm.PYTHON: ""}, [])
    if started is None:
        pytest.skip("this system has no such forks")
    code = "import time; print('there', flush=True); time.sleep(60)"
    running = subprocess.Popen([started.folder / warm.PYTHON, "-c", code], stdout=subprocess.PIPE, text=True)
    assert running.stdout.readline() == "there\n"
    started.close()
    assert running.wait(30) == -signal.SIGKILL and not started.folder.exists()
    running.stdout.close()


def test_a_hangup_that_is_ignored_stays_ignored(tmp_path):
    code = "import time; print('there', flush=True); time.sleep(1)"
    words = ["nohup", warm_python.interpreter(), "-c", code]
    running = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True)
    assert running.stdout.readline() == "there\n"
    running.send_signal(signal.SIGHUP)
    assert running.wait(30) == 0
    running.stdout.close()
