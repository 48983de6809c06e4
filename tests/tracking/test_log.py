"""A run log is read as typed records, and a line that cannot be used is named."""

from __future__ import annotations

import pytest
from logged import RUN

from expertaug.errors import InputError
from expertaug.tracking.log import read_log
from expertaug.tracking.run_log import RunLog


def test_a_log_of_version_0_1_is_read(tmp_path):
    """Its events have no time."""
    path = tmp_path / "log.jsonl"
    RunLog(path, RUN).close()
    lines = path.read_text().splitlines()
    path.write_text(
        "\n".join([lines[0], '{"event": "runs", "store": "sqlite:///x.db", "runs": ["a"]}', *lines[1:], ""])
    )
    assert [line.event for line in read_log(path).lines] == ["runs", "end"]


def test_torn_last_line_is_ignored_and_a_broken_one_named(tmp_path):
    path = tmp_path / "log.jsonl"
    RunLog(path, RUN).close()
    whole = path.read_bytes()
    path.write_bytes(whole + b'{"step": 1, "lo')
    assert len(read_log(path).lines) == 1
    path.write_bytes(whole + b"oops\n")
    with pytest.raises(InputError, match="line 3 is not JSON"):
        read_log(path)


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("[" * 100_000, "line 2 is not JSON"),
        ('{"event": "x", "time": 1, "y": ' + 5000 * "[" + 5000 * "]" + "}", "line 2 is not JSON"),
        ("3", "line 2: step: Input should be an object"),
        ('{"step": 1, "time": 2, "loss": [1, 2, 3]}', "line 2: loss has 3 values for 2 seeds"),
        ('{"step": 1, "time": 2, "loss": {"a": 1}}', "line 2: step.loss"),
        ('{"step": 1, "time": NaN}', "line 2: step.time: Input should be a finite number"),
        ('{"event": "artifact"}', "line 2: artifact.path: Field required"),
    ],
)
def test_a_line_that_no_training_wrote_is_named(tmp_path, line, found):
    RunLog(tmp_path / "log.jsonl", RUN).close()
    header = (tmp_path / "log.jsonl").read_text().splitlines()[0]
    (tmp_path / "log.jsonl").write_text(f"{header}\n{line}\n")
    with pytest.raises(InputError) as error:
        read_log(tmp_path / "log.jsonl")
    assert found in str(error.value) and "\n" not in str(error.value)
