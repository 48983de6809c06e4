"""The example of the README runs as it is written, and prints what it says."""

import re
import runpy
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "docs/example.py"
PRINTED = re.compile(r"(.+): omega0 is off by (\d+) %")


@pytest.mark.slow
def test_it_prints_two_sentences_of_which_the_second_is_better(capsys):
    names = runpy.run_path(str(EXAMPLE))
    printed = PRINTED.findall(capsys.readouterr().out)
    shown = PRINTED.findall(EXAMPLE.read_text(encoding="utf-8").replace("\n# ", "\n").split('%")\n')[1])
    assert [words for words, _ in printed] == [words for words, _ in shown] and len(printed) == 2
    for (_, found), (_, expected) in zip(printed, shown, strict=True):
        assert abs(int(found) - int(expected)) <= 15  # other processors round otherwise
    assert int(printed[1][1]) < int(printed[0][1]) - 15
    assert names["forecast"].y.shape == (50, 101, 2) and names["forecast"].z_e["omega0"].shape == (50,)


def test_it_has_fifteen_lines_beside_its_imports():
    lines = EXAMPLE.read_text(encoding="utf-8").splitlines()[1:]
    assert len([line for line in lines if line.strip() and not re.match("#|import |from ", line)]) <= 15
