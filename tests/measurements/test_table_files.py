"""Tables in, columns out: whatever the format, and texts of many rows by another parser as line by line."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from swings import NAMES, settings, swing, table, trials

from expertaug.errors import InputError
from expertaug.measurements import table_files as module
from expertaug.measurements.cut import all_chunks, measure
from expertaug.measurements.settings import TableKeys
from expertaug.measurements.table_files import read_table

RNG = np.random.default_rng(0)
NUMBERS = [
    [repr(float(v)) for v in RNG.standard_normal(4000) * 10.0 ** RNG.integers(-12, 12, 4000)],
    [f"{v:.17g}" for v in RNG.random(4000)],
    [str(k // 100) for k in range(4000)],
    [["", "NaN", "n/a", "-", "1e5", " 2.50", "+3", "-0", ".5", "7."][k % 10] for k in range(4000)],
    [["a", "b 1", "none", ""][k % 4] for k in range(4000)],
]
COLUMNS = ["x", "y", "run", "gaps", "word"]


def lines(separator=",", decimal=".", rows=NUMBERS, header=COLUMNS):
    cells = [[cell.replace(".", decimal) for cell in column] for column in rows]
    return [separator.join(header), *(separator.join(row) for row in zip(*cells, strict=True))]


PLAIN = {
    "commas": (lines(), {}),
    "semicolons and decimal commas": (lines(";", ","), {"decimal": ","}),
    "tabs": (lines("\t"), {}),
    "blanks": (lines("  ", rows=NUMBERS[:3], header=COLUMNS[:3]), {}),
    "a comment and a row of units above": (["# logged", *lines()[:1], "m,m,n,s,w", *lines()[1:]], {}),
    "lines skipped": (["a", "b,c", *lines()], {"skip_lines": 2}),
    "no header": (lines()[1:], {"names": COLUMNS}),
    "words from some row on": (lines(rows=[*NUMBERS[:4], [*NUMBERS[2][:3500], *NUMBERS[4][:500]]]), {}),
    "quoted": ([line.replace(",", '","').join('""') for line in lines()], {}),
}
LINE_BY_LINE = {
    "a comment between": ([*lines()[:2000], "# a pause", *lines()[2000:]], {}),
    "a blank line between": ([*lines()[:2000], "", *lines()[2000:]], {}),
    "letters of another encoding": ([*lines()[:2000], lines()[2000] + "ö", *lines()[2001:]], {}),
    "a number that single precision lacks": ([*lines()[:9], "1e25,1,2,3,a", *lines()[9:]], {}),
    "a comma within quotes": ([*lines()[:9], '1,1,2,3,"a,b"', *lines()[9:]], {}),
}
REFUSED = {
    "a cell too few": [*lines()[:3000], lines()[3000].rpartition(",")[0], *lines()[3001:]],
    "a cell too many": [*lines()[:3000], lines()[3000] + ",1", *lines()[3001:]],
    "too few here, too many there": [*lines()[:3000], "1,2,3,4", "1,2,3,4,5,6", *lines()[3002:]],
}


def both(path, keys, monkeypatch):
    """A table by either way, and whether the fast one was taken."""
    keys = TableKeys(**keys)
    monkeypatch.setattr(module, "LARGE", 0)
    monkeypatch.setattr(module, "HEAD", 4096)
    fast = module._read_large(path, keys)
    large = read_table(path, keys)
    monkeypatch.setattr(module, "LARGE", 2**60)
    return read_table(path, keys), large, fast is not None


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("case", [*PLAIN, *LINE_BY_LINE])
def test_the_same_table(tmp_path, monkeypatch, case, ending):
    rows, keys = (PLAIN | LINE_BY_LINE)[case]
    path = tmp_path / "a.csv"
    path.write_bytes((ending.join(rows) + ending).encode())
    slow, large, fast = both(path, keys, monkeypatch)
    assert fast == (case in PLAIN)
    assert large.names == slow.names and np.array_equal(large.line, slow.line) and large.units == slow.units
    for name in slow.names:
        assert large.texts(name).tolist() == slow.texts(name).tolist(), name
        if name != "word":
            assert np.array_equal(large.numbers(name), slow.numbers(name), equal_nan=True), name
        one, other = large.mostly(name), slow.mostly(name)
        assert (one is None) == (other is None)
        assert one is None or np.array_equal(one, other, equal_nan=True)


def test_rows_of_one_text_share_it(tmp_path, monkeypatch):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines()))
    monkeypatch.setattr(module, "LARGE", 0)
    large = read_table(path, TableKeys())
    for texts, count in ((large.cells["word"], 4), (large.texts("word"), 4), (large.texts("run"), 40)):
        assert len(set(map(id, texts))) == count
    rows = large.kinds("run").rows()
    assert list(rows) == [str(k) for k in range(40)] and np.array_equal(rows["7"], np.arange(700, 800))
    assert np.array_equal(large.kinds("word").rows()["b 1"], np.arange(1, 4000, 4))


@pytest.mark.parametrize("case", REFUSED)
def test_the_same_refusal_of_rows(tmp_path, monkeypatch, case):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(REFUSED[case]))
    monkeypatch.setattr(module, "LARGE", 0)
    with pytest.raises(InputError, match=r"row 3001 has \d cells, the header has 5"):
        read_table(path, TableKeys())


@pytest.mark.parametrize("cell", ["much", "1_000", "inf", "1e40", "1,5"])
def test_the_same_refusal_of_a_cell(tmp_path, monkeypatch, cell):
    rows = lines(";")
    rows[3000] = f"0;{cell};" + rows[3000].split(";", 2)[2]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows))
    slow, large, _ = both(path, {}, monkeypatch)
    said = []
    for one in (slow, large):
        with pytest.raises(InputError) as error:
            one.numbers("y")
        said.append(str(error.value))
    assert said[0] == said[1] and f"row 3001, column y: '{cell}'" in said[0]


@pytest.mark.slow
def test_inspecting_a_table_loads_no_torch(tmp_path):
    path = tmp_path / "swings.csv"
    path.write_text("t,theta\n" + "".join(f"{k / 50},{np.cos(k / 10)}\n" for k in range(1000)))
    code = "import sys; from expertaug.cli import main; main(sys.argv[1:]); print('torch' in sys.modules)"
    command = ["inspect-data", str(path), "--system", "pendulum", "--output", str(tmp_path / "seen.png")]
    done = subprocess.run([sys.executable, "-c", code, *command], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("# 1 file, 1 trajectory") and done.stdout.endswith("\nFalse\n")


@pytest.mark.parametrize("separator", [",", ";", "\t", "|", " "])
def test_any_common_separator_gives_the_same_numbers(tmp_path, separator):
    y = swing(1.0)
    path = table(tmp_path / "a.csv", {"t": 0.05 * np.arange(200), "angle": y[:, 0]}, separator, "# from a lab\n\n")
    found = read_table(path, TableKeys())
    assert found.names == ["t", "angle"] and np.array_equal(found.numbers("angle"), y[:, 0])
    assert found.line[0] == 4 and found.line[-1] == 203  # as an editor counts


def test_commas_as_decimals_units_row_and_other_encodings(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes("t;Höhe\ns;mm\n0,0;1,5\n0,1;\n".encode("latin-1"))
    found = read_table(path, TableKeys(decimal=","))
    assert found.numbers("Höhe")[0] == 1.5 and np.isnan(found.numbers("Höhe")[1])
    assert found.units == {"t": "s", "Höhe": "mm"}
    path.write_text("t,x\n0,1\n", encoding="utf-16")
    assert read_table(path, TableKeys()).numbers("x").tolist() == [1.0]


def test_parquet_npz_and_csv_give_the_same_chunks(tmp_path):
    path = trials(tmp_path)
    frame = pd.read_csv(path)
    frame.to_parquet(tmp_path / "swings.parquet")
    np.savez(tmp_path / "swings.npz", **{name: frame[name].to_numpy() for name in frame})
    found = [all_chunks(measure(settings(tmp_path / f"swings.{end}"), NAMES)) for end in ("csv", "parquet", "npz")]
    for other in found[1:]:
        assert np.array_equal(found[0].y, other.y) and np.array_equal(found[0].t, other.t)
