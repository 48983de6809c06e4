"""Broken measurements: one line that names the file or the key and what would be right, and nothing touched."""

import hashlib
import json
import re

import numpy as np
import pytest
from swings import GIVEN, trials

from expertaug.cli import main


def edited(change):
    """Break the text of a good table: a function of its lines."""

    def write(folder):
        path = trials(folder)
        lines = path.read_text().splitlines()
        path.write_text("\n".join(change(lines)) + "\n")
        return path

    return write


def other(name, data):
    """Bytes under a name."""

    def write(folder):
        (folder / name).write_bytes(data)
        return folder / name

    return write


def arrays(**values):
    def write(folder):
        np.savez(folder / "a.npz", **values)
        return folder / "a.npz"

    return write


def cell(row, column, text):
    """The text of one cell; the header is row 1."""

    def change(lines):
        cells = lines[row - 1].split(",")
        cells[column] = text
        return [*lines[: row - 1], ",".join(cells), *lines[row:]]

    return edited(change)


good = edited(list)
BROKEN = {
    "a word among numbers": (cell(7, 2, "much"), {}, r"row 7, column angle: 'much' is no number; expected a number"),
    "a comma as decimal": (
        edited(lambda ls: [line.replace(",", ";").replace(".", ",") for line in ls]),
        {},
        r"row 2, column t: '0,0' is no number; for numbers with a comma set data.files.decimal",
    ),
    "a quoted name over two lines": (
        edited(lambda ls: ['"trial","t\n(s)",angle,speed', *ls[1:]]),
        {},
        "row 1: the quoted name of a column goes on in the next line; write each name in one line",
    ),
    "infinity": (cell(7, 3, "inf"), {}, "row 7, column speed: 'inf' is no number"),
    "a huge number": (cell(7, 3, "1e40"), {}, "row 7, column speed: 1e\\+40 is far from all others"),
    "an underscore": (cell(7, 3, "1_000"), {}, "row 7, column speed: '1_000' is no number"),
    "no time": (cell(9, 1, ""), {}, "row 9, column t: '' is no time; every row needs a time"),
    "a cell too few": (
        edited(lambda ls: [*ls[:4], ls[4].rpartition(",")[0], *ls[5:]]),
        {},
        "row 5 has 3 cells, the header",
    ),
    "a cell too many": (edited(lambda ls: [*ls[:4], ls[4] + ",1", *ls[5:]]), {}, "row 5 has 5 cells, the header has 4"),
    "cut in the middle": (edited(lambda ls: [*ls[:50], ls[50][:9]]), {}, r"row 51 has \d cells"),
    "no header": (edited(lambda ls: ls[1:]), {}, r"row 1 holds numbers .*; name the 4 columns in data.files.names"),
    "another column": (
        edited(lambda ls: [ls[0].replace("angle", "phi"), *ls[1:]]),
        {},
        "no column 'angle'; its columns are",
    ),
    "two columns of one name": (
        edited(lambda ls: [ls[0].replace("speed", "angle"), *ls[1:]]),
        {},
        "two columns are called",
    ),
    "a column without a number": (
        edited(lambda ls: [ls[0], *(line.rpartition(",")[0] + "," for line in ls[1:])]),
        {},
        "column speed holds no number; leave data.files.columns.omega out",
    ),
    "only a header": (edited(lambda ls: ls[:1]), {}, "holds no rows"),
    "empty": (other("a.csv", b""), {}, "holds no rows"),
    "only comments": (other("a.csv", b"# a\n% b\n"), {}, "holds no rows"),
    "a picture called csv": (other("a.csv", b"\x89PNG\0\0\0"), {}, "no text: it holds zero bytes"),
    "a spreadsheet": (other("a.xlsx", b"PK"), {}, "ends in '.xlsx'; tables are .csv"),
    "no npz": (other("a.npz", b"PK\x03\x04nothing"), {}, "not a file of arrays"),
    "no parquet": (other("a.parquet", b"PAR1nothing"), {}, "not a Parquet file"),
    "arrays of two lengths": (arrays(t=np.arange(5.0), x=np.arange(4.0)), {}, r"array x has shape \(4,\), t \(5,\)"),
    "matrices": (arrays(t=np.zeros((5, 2))), {}, r"array t has shape \(5, 2\)"),
    "objects": (arrays(t=np.array([{}, {}], dtype=object)), {}, "not a file of arrays"),
    "a trajectory after another": (
        good,
        {"trajectory": None},
        r"row 202: the time goes back .* name the column that tells",
    ),
    "another component": (
        good,
        {"columns": {"phi": "angle"}},
        "columns.phi: 'phi' is no component of the state; known",
    ),
    "another parameter": (good, {"z_e": {"length": "speed"}}, "z_e.length: 'length' is no expert parameter"),
    "a unit of another kind": (
        good,
        {"columns": {"theta": {"name": "angle", "unit": "mm"}}},
        "columns.theta.unit: 'mm' is a unit of length, the system has rad",
    ),
    "a chunk longer than any trajectory": (
        good,
        {"length": 500},
        "length: found 500, the longest trajectory without a long gap has 200 points",
    ),
    "a step that does not divide": (good, {"step_s": 0.07}, r"step_s: found 0.07, rows are 0.05 s apart"),
    "a formula of other columns": (
        good,
        {"columns": {"theta": {"name": "angle", "formula": "arcsin(volts)"}}},
        r"columns.theta.formula: 'arcsin\(volts\)' names 'volts'; known: x",
    ),
    "a formula that is code": (
        good,
        {"columns": {"theta": {"name": "angle", "formula": "x.__class__"}}},
        "columns.theta.formula: .* has 'x.__class__'; only",
    ),
    "an unknown key": (good, {"lenght": 20}, "lenght: unknown key; did you mean 'length'"),
    "a quantity of nothing": (
        good,
        {"split": {"by": "quantity", "quantity": "height**2"}},
        "'height\\*\\*2' names 'height'; known: theta, omega",
    ),
    "a quantity that is code": (
        good,
        {"split": {"by": "quantity", "quantity": "theta.__class__"}},
        "has 'theta.__class__'; only",
    ),
    "no quantity": (good, {"split": {"by": "quantity"}}, "quantity is missing; by is quantity: give quantity"),
    "a split of no file": (good, {"split": {"by": "file"}}, "split.train: no file is 'train'; there are 'swings.csv'"),
    "shares that do not sum to one": (
        good,
        {"split": {"train_share": 0.9}},
        "the shares sum to 1.3; they must sum to 1",
    ),
    "other names": (good, {"names": ["a", "b"]}, "row 1 has 4 cells, data.files.names has 2"),
    "a checksum of other bytes": (
        good,
        {"checksums": "{SUMS}"},
        r"SHA-256 is \w+; 0{64} expected: copy the file again",
    ),
    "no checksums": (good, {"checksums": "nowhere"}, "checksums: 'nowhere' cannot be read"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_each_defect_is_one_line_and_touches_nothing(tmp_path, capsys, case):
    write, more, message = BROKEN[case]
    path = write(tmp_path)
    sums = tmp_path / "SHA256SUMS"
    sums.write_text(f"{'0' * 64}  {path.name}\n")
    given = json.loads(json.dumps(GIVEN | more | {"paths": str(path)}).replace("{SUMS}", str(sums)))
    before = hashlib.sha256(path.read_bytes()).hexdigest()
    out = tmp_path / "data"
    settings = json.dumps({"system": {"name": "pendulum"}, "files": given})
    assert main(["cut-measurements", str(path), "--output", str(out), "--settings", settings]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and said.startswith("expertaug cut-measurements: "), said
    assert re.search(message, said), said
    assert not out.exists() and hashlib.sha256(path.read_bytes()).hexdigest() == before


@pytest.mark.parametrize("seed", range(20))
def test_damaged_bytes_never_end_in_a_traceback(tmp_path, capsys, seed):
    rng = np.random.default_rng(seed)
    path = trials(tmp_path, count=2, points=60)
    data = bytearray(path.read_bytes())
    for place in rng.integers(0, len(data), 1 + seed % 5):
        data[place] = rng.integers(0, 256)
    path.write_bytes(bytes(data[: rng.integers(1, len(data))]) if seed % 3 == 0 else bytes(data))
    settings = json.dumps(
        {"system": {"name": "pendulum"}, "files": GIVEN | {"paths": str(path), "split": {"by": "time"}}}
    )
    status = main(["cut-measurements", str(path), "--output", str(tmp_path / "data"), "--settings", settings])
    said = capsys.readouterr().err
    assert status in (0, 2) and "Traceback" not in said and said.count("\n") == (status == 2)
