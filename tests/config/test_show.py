"""expertaug config show: what the jobs of a method get, and where each value was said."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from expertaug import cli
from expertaug.config import load as config
from expertaug.config.show import show
from expertaug.errors import InputError

ROOT = Path(__file__).parents[2]
MINE = """results: results/mine
seeds: [4]
experiments:
  mine:
    based_on: pendulum
    training: {epochs: 7}
    choices: {noise: none}
    overrides:
      aphynity: {training: {batch_size: 9}}
run: [mine]
"""


@pytest.fixture
def found(tmp_path, monkeypatch) -> dict[str, dict[str, tuple[str, str]]]:
    """Key → value and origin, by job."""
    monkeypatch.chdir(ROOT)
    path = tmp_path / "mine.yaml"
    path.write_text(MINE)
    read: dict[str, dict[str, tuple[str, str]]] = {}
    for line in show(config.load(config.with_defaults([path])), "mine", "aphynity"):
        match = re.fullmatch(r"  (\S+): (.*?) +# (.*)", line)
        if match is None:
            job = read[line] = {}
        else:
            job[match[1]] = (match[2], match[3].replace(str(path), "mine.yaml"))
    return read


def test_every_job_of_the_method_is_there(found):
    jobs = [f"{job} aphynity{plus} seeds_4" for job, plus in (("train", ""), ("augment", "+"), ("finetune", "+"))]
    assert {*jobs, "evaluate aphynity seeds_4", "evaluate aphynity+wide seeds_4", "simulate train"} <= set(found)


def test_each_value_has_its_origin(found):
    train = found["train aphynity seeds_4"]
    pendulum = (ROOT / "config/experiments/pendulum.yaml").read_text().splitlines()
    rate = next(k for k, line in enumerate(pendulum, 1) if "learning_rate" in line)
    assert train["training.epochs"] == ("7", "mine.yaml:6")
    assert train["training.batch_size"] == ("9", "mine.yaml:9, overrides of aphynity")
    inherited = f"config/experiments/pendulum.yaml:{rate}, mine is based on pendulum"
    assert train["training.learning_rate"] == ("0.003", inherited)
    assert train["training.warmup"] == ("0.1", "default")
    assert train["choices.multiplier"] == ("'lagrangian'", "preset corrected")
    assert train["seeds"] == ("[4]", "mine.yaml:2")
    assert train["device"] == ("'auto'", "default")
    tune = found["finetune aphynity+ seeds_4"]
    assert tune["choices.resample"][0] == "'epoch'"
    assert "under the preset corrected" in tune["choices.resample"][1]
    assert found["augment aphynity+wide seeds_4"]["prior.omega0"][0] == "[0.1, 7.0]"
    assert found["augment aphynity+ seeds_4"]["noise"][0] == "0.0"


def test_what_does_not_exist_is_one_line(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert cli.main(["config", "show", "pendulm", "aphynity"]) == 2
    assert "EXPERIMENT: 'pendulm' is no experiment; did you mean 'pendulum'?" in capsys.readouterr().err
    with pytest.raises(InputError, match="METHOD: 'aphinity' is no method of this experiment"):
        list(show(config.load(config.with_defaults([])), "pendulum", "aphinity"))


def test_words_choose_what_is_shown(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    assert cli.main(["config", "show", "pendulum", "aphynity+", "learning_rate", "flow"]) == 0
    lines = capsys.readouterr().out.splitlines()
    jobs = [line for line in lines if not line.startswith(" ")]
    assert {line.split()[0] for line in jobs} == {"train", "finetune", "flow", "evaluate"}  # of the flow the last
    assert all("learning_rate" in line for line in lines[1 : lines.index(jobs[1])])
    assert cli.main(["config", "show", "pendulum", "aphynity", "learnin_rate"]) == 2
    assert "WORD: learnin_rate: in no job and no key" in capsys.readouterr().err
