"""The command line: statuses, one-line errors, logs; the stages have their own tests."""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from expertaug import cli, commands
from expertaug.config import stage_code
from expertaug.errors import SolveError
from expertaug.systems import simulate
from expertaug.tracking import mlflow_store

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


def test_a_failed_solve_is_one_line_and_status_3(tmp_path, capsys, monkeypatch):
    def fail(*_):
        raise SolveError("sample 3 is not finite")

    monkeypatch.setattr(simulate, "simulate", fail)
    assert run("simulate", "train", "--output", tmp_path / "x.npz", "--settings", "{}") == 3
    assert capsys.readouterr().err == "expertaug simulate: sample 3 is not finite\n"


@pytest.mark.parametrize(("error", "status"), [(KeyboardInterrupt(), 130), (ZeroDivisionError("oh"), 1)])
def test_interrupts_and_bugs(error, status, monkeypatch, capsys, tmp_path):
    def fail(*_):
        raise error

    monkeypatch.setattr(simulate, "simulate", fail)
    assert run("simulate", "train", "--output", tmp_path / "x.npz", "--settings", "{}") == status
    assert ("Traceback" in capsys.readouterr().err) == (status == 1)


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path, capsys):
    (tmp_path / "file").touch()
    settings = json.dumps(PENDULUM)
    assert run("simulate", "train", "--output", tmp_path / "file" / "x.npz", "--settings", settings) == 2
    assert run("simulate", "train", "--output", "x", "--settings", settings, "--log", tmp_path / "file" / "log") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and all("cannot be written" in line for line in lines)


def test_validate(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert run("validate", "config/config.yaml", "config/smoke.yaml") == 0
    bad = tmp_path / "bad.yaml"
    bad.write_text("seeds: [one]\n")
    assert run("validate", "config/config.yaml", bad) == 2
    assert "seeds[0]: found 'one'; give a whole number" in capsys.readouterr().err


def test_tracking_store_is_prepared_or_switched_off(tmp_path, monkeypatch):
    def prepare(uri, experiment, marker):
        Path(marker).write_text(json.dumps({"uri": uri, "experiment": experiment}))

    monkeypatch.setattr(mlflow_store, "initialise", prepare)
    output = tmp_path / "tracking.json"
    settings = {"enabled": True, "uri": "sqlite:///x.db", "experiment": "e"}
    assert run("init-tracking", "--output", output, "--settings", json.dumps(settings)) == 0
    files = [f"--{name}={name}" for name in ("data", "output", "work", "settings")]
    found = commands._tracking(commands.parser().parse_args(["train", *files, f"--tracking={output}"]))
    assert found == settings | {"tags": {"rule": "train"}}
    assert run("init-tracking", "--output", output, "--settings", json.dumps(settings | {"enabled": False})) == 0
    assert json.loads(output.read_text()) == {"enabled": False}


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


def test_one_thread_a_job():
    environment = {k: v for k, v in os.environ.items() if k != "OMP_NUM_THREADS"}
    code = "import expertaug.cli, os; print(os.environ['OMP_NUM_THREADS'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.strip() == "1"


def test_every_stage_has_a_command():
    actions = commands.parser()._subparsers._group_actions[0].choices
    by_hand = {"forecast", "inspect", "validate", "rebuild-tracking", "publish"}
    assert {stage.replace("_", "-") for stage in stage_code.STAGES} == set(actions) - by_hand
