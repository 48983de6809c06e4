"""Names of columns and files are whatever they are: the YAML that inspect-data prints reads back as exactly these."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from expertaug.cli import main
from expertaug.config import load as config
from expertaug.config import sources
from expertaug.errors import InputError
from expertaug.measurements.proposal import comment, flow
from expertaug.stages import STAGES

ROOT = Path(__file__).parents[2]

ODD = [
    "a\ntracking: {uri: x}",
    "a\r\nb",
    'it\'s "so"',
    "a: b # c",
    "-x",
    "{a}, [b]",
    "ω̇ [°/s]",
    "\u2028\x85\t",
    "yes",
    "1e3",
    " a ",
    "%&*!|>@`",
    "\x07\U0001f600",
]


@pytest.mark.parametrize("name", ODD)
def test_values_stay_on_one_line_and_read_back(name):
    value = {"columns": {name: {"name": name, "unit": None}}, "list": [name, 1.5, True]}
    line = flow(value)
    assert len(line.splitlines()) == 1 and yaml.safe_load(line) == value
    assert yaml.safe_load(f"a:\n    b: {line}\n    c: 1") == {"a": {"b": value, "c": 1}}
    assert len(comment(name).splitlines()) == 1


def test_texts_drawn_at_random_read_back():
    rng = np.random.default_rng(0)
    signs = [chr(k) for k in range(1, 0x250)] + list("\u2028\u2029\ufeff∂θ€😀") + list("'\"#:{}[]-?&*!|>%@`\n") * 20
    for _ in range(2000):
        text = "".join(rng.choice(signs, rng.integers(1, 12)))
        if all(c in "\t\n\r\x85" or (c >= " " and not "\x7f" <= c <= "\x9f") for c in text):
            assert yaml.safe_load(flow({text: [text]})) == {text: [text]}, repr(text)
            assert len(flow([text]).splitlines()) == 1


@pytest.mark.parametrize("name", ODD)
def test_a_column_of_any_name_adds_no_keys(tmp_path, capsys, name):
    t = 0.1 * np.arange(100)
    frame = pd.DataFrame({"t": t, name: np.cos(t), "omega": -np.sin(t)})
    pytest.importorskip("pyarrow")
    frame.to_parquet(tmp_path / "a.parquet")
    command = ["inspect-data", str(tmp_path / "a.parquet"), "--output", str(tmp_path / "x.png")]
    assert main(command) == 0
    config = yaml.safe_load(capsys.readouterr().out)
    assert list(config) == ["results", "run", "experiments"]
    columns = config["experiments"]["measured"]["data"]["files"]["columns"].values()
    assert name in columns


@pytest.mark.parametrize(("name", "said"), [("-x.csv", "begins with a dash"), ("a{b}.csv", "has braces")])
def test_names_that_the_workflow_takes_otherwise_are_refused(name, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    t = np.arange(400) * 0.05
    rows = pd.DataFrame({"t": t, "theta": np.cos(2 * t), "omega": -2 * np.sin(2 * t)})
    rows.to_csv(tmp_path / name, index=False)
    if name.startswith("-"):
        with pytest.raises(SystemExit) as stop:
            main(["inspect-data", name, "--system", "pendulum"])
        assert stop.value.code == 2 and "write ./-x.csv" in capsys.readouterr().err
    assert main(["inspect-data", f"./{name}", "--system", "pendulum"]) == 0
    (tmp_path / "mine.yaml").write_text(capsys.readouterr().out)
    given = config.complete_configuration(
        config.load([ROOT / "config" / "config.yaml", tmp_path / "mine.yaml"]), STAGES
    )
    with pytest.raises(InputError, match=rf"{said}.*; rename it"):
        sources.list_measurements(given)
