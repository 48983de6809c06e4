"""The command line: statuses, one-line errors, logs; the stages have their own tests."""

from __future__ import annotations

import errno
import json
import logging
import os
import platform
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from expertaug import cli, commands
from expertaug.errors import SolveError
from expertaug.stages import STAGES, options
from expertaug.systems import simulate
from expertaug.tracking import store
from expertaug.tracking.settings import Tracking

ROOT = Path(__file__).parents[1]
PENDULUM = {
    "system": {"name": "pendulum"},
    "data": {
        "seed": 0,
        "step_s": 0.1,
        "t2_s": 1.0,
        "noise": 0.0,
        "sets": {"train": {"size": 3, "z_e": {"omega0": [1.0, 2.0]}, "z_a": {"alpha": [0.0, 0.1]}}},
    },
}


@pytest.fixture(autouse=True)
def restored_logging():
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level
    yield
    for handler in set(root.handlers) - set(handlers):
        handler.close()
    root.handlers, root.level = handlers, level


def run(*arguments: object) -> int:
    return cli.main([str(a) for a in arguments])


def test_a_stage_runs_and_logs(tmp_path, capsys):
    settings = tmp_path / "settings.yaml"
    settings.write_text(json.dumps(PENDULUM))
    for text in (json.dumps(PENDULUM), settings):
        output, log = tmp_path / "train.npz", tmp_path / "logs" / "simulate.log"
        assert run("simulate", "train", "--output", output, "--settings", text, "--log", log) == 0
        assert np.load(output)["y"].shape == (3, 11, 2)
        assert log.is_file()


def test_bad_input_is_one_line_and_status_2(tmp_path, capsys):
    log = tmp_path / "log"
    status = run(
        "measure-angles", tmp_path / "none.csv", "--output", "a", "--summary", "b", "--settings", "{}", "--log", log
    )
    error = capsys.readouterr().err
    assert status == 2
    assert error.startswith("expertaug measure-angles: ") and error.count("\n") == 1 and "none.csv" in error
    assert error.strip() in log.read_text()


@pytest.mark.parametrize("text", ["nowhere.json", "[1]", "{", "{a: [}"])
def test_bad_settings(text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run("simulate", "train", "--output", "x.npz", "--settings", text) == 2
    assert "--settings" in capsys.readouterr().err
    assert not Path("x.npz").exists()


@pytest.mark.parametrize(
    ("arguments", "settings", "expected"),
    [
        (["simulate", "train"], "{}", "--settings.system: missing; give system (name and arguments of the system)"),
        (["simulate", "train"], '{"system": 3, "data": {}}', "--settings.system: found 3; give a mapping of keys"),
        (["train", "--data=d", "--work=w"], '{"experiment": "x"}', "--settings.method: missing"),
        (["init-tracking"], '{"enabled": true}', "--settings.uri: missing; give uri (of the store)"),
        (["augment", "--model=m", "--data=d"], "{}", "--settings.choices: missing"),
    ],
)
def test_settings_by_hand_are_told_what_they_lack(arguments, settings, expected, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(*arguments, "--output", "x.npz", "--settings", settings) == 2
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith(f"expertaug {arguments[0]}: --settings") for line in lines)
    assert any(expected in line for line in lines)


def test_a_failed_solve_is_one_line_and_status_3(tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise SolveError("sample 3 is not finite")

    monkeypatch.setattr(simulate, "simulate", fail)
    assert run("simulate", "train", "--output", tmp_path / "x.npz", "--settings", json.dumps(PENDULUM)) == 3
    assert capsys.readouterr().err == "expertaug simulate: sample 3 is not finite\n"


@pytest.mark.parametrize(("error", "status"), [(KeyboardInterrupt(), 130), (ZeroDivisionError("oh"), 1)])
def test_interrupts_and_bugs(error, status, monkeypatch, capsys, tmp_path):
    def fail(*_):
        raise error

    monkeypatch.setattr(simulate, "simulate", fail)
    assert run("simulate", "train", "--output", tmp_path / "x.npz", "--settings", json.dumps(PENDULUM)) == status
    assert ("Traceback" in capsys.readouterr().err) == (status == 1)


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (IsADirectoryError(errno.EISDIR, "Is a directory", "somewhere"), 2),
        (NotADirectoryError(errno.ENOTDIR, "Not a directory", "somewhere"), 2),
        (OSError(errno.ELOOP, "Too many levels of symbolic links", "somewhere"), 2),
        (OSError(errno.ENOSPC, "No space left on device"), 2),
        (OSError(errno.EBADF, "Bad file descriptor"), 1),
        (ConnectionResetError(errno.ECONNRESET, "Connection reset by peer"), 1),
    ],
)
def test_an_error_about_a_file_is_one_line_and_any_other_a_bug(error, status, monkeypatch, capsys, tmp_path):
    def fail(*_):
        raise error

    monkeypatch.setattr(simulate, "simulate", fail)
    assert run("simulate", "train", "--output", tmp_path / "x.npz", "--settings", json.dumps(PENDULUM)) == status
    text = capsys.readouterr().err
    assert ("Traceback" in text) == (status == 1) and error.strerror in text
    assert status == 1 or (text.count("\n") == 1 and (error.filename or "output") in text)


LONG, LOOP, FOLDER = "a" * 5000, "loop/x", "folder"


@pytest.mark.parametrize(
    "arguments",
    [
        ["rebuild-tracking", LONG],
        ["rebuild-tracking", LOOP],
        ["simulate", "train", f"--output={LONG}", f"--settings={json.dumps(PENDULUM)}"],
        ["summarise-recordings", FOLDER, "--output=a.csv", "--markdown=a.md"],
        ["log-evaluations", "f", "--output=o", f"--tracking={FOLDER}"],
        ["publish", FOLDER, "--to=x", "--command=c"],
        ["inspect-video", LOOP],
        ["inspect", LOOP],  # as it was called
    ],
    ids=lambda arguments: f"{arguments[0]} {arguments[1][:10]}",
)
def test_paths_that_cannot_be_used_are_one_line(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("loop").symlink_to("loop")
    Path("folder").mkdir()
    assert run(*arguments) == 2
    text = capsys.readouterr().err
    assert text.startswith(f"expertaug {arguments[0]}: ") and text.count("\n") == 1


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path, capsys):
    (tmp_path / "file").touch()
    settings = json.dumps(PENDULUM)
    assert run("simulate", "train", "--output", tmp_path / "file" / "x.npz", "--settings", settings) == 2
    assert run("simulate", "train", "--output", "x", "--settings", settings, "--log", tmp_path / "file" / "log") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and all("cannot be written" in line for line in lines)


def test_tracking_store_is_prepared_or_switched_off(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "connect", lambda uri, experiment, prepare: (None, f"id of {experiment}"))
    output = tmp_path / "tracking.json"
    settings = {"enabled": True, "uri": "sqlite:///x.db", "experiment": "e", "experiments": ["swing"]}
    assert run("init-tracking", "--output", output, "--settings", json.dumps(settings)) == 0
    files = [f"--{name}={name}" for name in ("data", "output", "work", "settings")]
    arguments = commands.parser().parse_args(["train", *files, f"--tracking={output}"])
    assert options.tracking_of(arguments) == Tracking(
        **settings | {"experiments": {"swing": "id of e swing"}}, rule="train"
    )
    assert run("init-tracking", "--output", output, "--settings", json.dumps(settings | {"enabled": False})) == 0
    assert json.loads(output.read_text()) == {"enabled": False}
    assert options.tracking_of(arguments) is None


@pytest.mark.parametrize("arguments", [["--version"], ["validate", "config/config.yaml", "config/smoke.yaml"]])
def test_what_needs_no_numerical_library_loads_none(arguments):
    code = """if True:
        import sys
        from expertaug import cli
        try:
            cli.main(sys.argv[1:])
        except SystemExit:
            pass
        print({"numpy", "torch", "cv2"} & set(sys.modules))
    """
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.splitlines()[-1] == "set()"


def faults(kept: bool) -> int:
    """Pages that the system has to give while blocks of 8 MiB come and go."""
    code = f"""if True:
        import resource, numpy as np
        from expertaug import cli
        {"cli.keep_freed_memory()" if kept else ""}
        for _ in range(50):
            held = [np.ones(2**20) for _ in range(8)]
            del held
        print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.slow
@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="mallopt is glibc's")
def test_freed_memory_is_kept_for_the_next_tensors():
    assert faults(True) < faults(False) / 5


def test_commands_keep_freed_memory(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(cli, "keep_freed_memory", lambda: asked.append(True))
    run("simulate", "train", "--output", tmp_path / "x.npz", "--settings", json.dumps(PENDULUM))
    assert asked == [True]


def test_one_thread_a_job():
    environment = {k: v for k, v in os.environ.items() if k != "OMP_NUM_THREADS"}
    code = "import expertaug.cli, os; print(os.environ['OMP_NUM_THREADS'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.strip() == "1"


def test_every_stage_has_a_command():
    actions = commands.parser()._subparsers._group_actions[0].choices
    by_hand = {
        "check-system",
        "config",
        "forecast",
        "inspect",  # as inspect-video was called
        "example-table",
        "inspect-data",
        "inspect-video",
        "validate",
        "rebuild-tracking",
        "publish",
        "run",
        "demand",
    }
    former = {name for stage in STAGES.values() for name in stage.former}
    assert former == {"own-priors", "review-recording"} and former < set(actions)
    assert {stage.name for stage in STAGES.values()} == set(actions) - by_hand - former


def test_a_reader_that_has_seen_enough_is_no_error():
    command = f"{sys.executable} -m expertaug.cli config show rlc aphynity | head -n 1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, cwd=ROOT)
    assert done.stdout.count("\n") == 1 and done.stderr == ""


def test_the_help_groups_every_command(capsys):
    with pytest.raises(SystemExit) as stop:
        run("--help")
    assert stop.value.code == 0
    text = capsys.readouterr().out
    groups = re.split(r"^(\w[^\n]*):$", text, flags=re.M)
    listed = [set(re.findall(r"^  ([a-z-]+)(?: |$)", part, re.M)) for part in groups[-5::2]]
    use, inspected, stages = listed
    assert {"run", "inspect-data", "forecast"} <= use and {"validate", "config"} <= inspected
    assert stages == {stage.name for stage in STAGES.values()}
    assert max(map(len, text.splitlines())) <= 100


@pytest.mark.parametrize("name", commands.parser()._subparsers._group_actions[0].choices)
def test_every_command_has_a_help(name, capsys):
    with pytest.raises(SystemExit) as stop:
        run(name, "--help")
    assert stop.value.code == 0 and "usage: expertaug " in capsys.readouterr().out


def test_every_command_that_is_no_stage_has_examples_that_it_takes(capsys):
    actions = commands.parser()._subparsers._group_actions[0].choices
    shown = 0
    of_stages = {name for stage in STAGES.values() for name in (stage.name, *stage.former)}
    for name in set(actions) - of_stages - {"inspect"}:  # one command's former name
        lines = actions[name].epilog.splitlines()[1:]
        for line in lines:
            program, *words = shlex.split(line.split(" > ")[0], comments=True)
            assert program == "expertaug" and words[0] == name
            commands.parse(words)
            shown += 1
    assert shown >= 10


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("trian", "did you mean train?"),
        ("validat", "did you mean validate"),
        ("inspct", "did you mean inspect-video or inspect-data?\n"),
        ("xyz", "expertaug --help lists all"),
    ],
)
def test_a_misspelt_command_is_one_line_with_a_suggestion(word, expected, capsys):
    with pytest.raises(SystemExit) as stop:
        run(word, "--output", "x")
    error = capsys.readouterr().err
    assert stop.value.code == 2 and error.count("\n") == 1
    assert f"no command '{word}'" in error and expected in error
