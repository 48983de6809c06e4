"""Names of columns and files are whatever they are: the YAML that inspect-data prints reads back as exactly these."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import yaml

from expertaug.cli import main
from expertaug.measurements.proposal import comment, flow

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
