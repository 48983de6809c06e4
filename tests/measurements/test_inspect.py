"""What inspect-data sees in a table, and the configuration that it proposes."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from swings import NAMES

from expertaug.cli import main
from expertaug.measurements.cut import measure, sets_of
from expertaug.measurements.inspect import Inspection
from expertaug.measurements.names import Names
from expertaug.measurements.settings import MeasurementSettings

POINT_MASSES = '{"name": "double_pendulum", "expert": "point_mass"}'


@pytest.mark.parametrize("header", [True, False])
def test_commas_in_numbers_are_seen_and_proposed(tmp_path, capsys, header):
    rows = [f"{k / 50:.3f};{40 * np.cos(5.2 * k / 50):.2f}".replace(".", ",") for k in range(1000)]
    path = tmp_path / "spring.csv"
    path.write_text("\n".join([*(["Time (s);Position (mm)"] if header else []), *rows, ""]))
    assert main(["inspect-data", str(path), "--output", str(tmp_path / "seen.png")]) == 0
    told = capsys.readouterr().out
    assert "step: 0.02 s (50 Hz)" in told and "-40 to 40" in told
    files = yaml.safe_load(told)["experiments"]["measured"]["data"]["files"]
    assert files["decimal"] == ","
    data = measure(MeasurementSettings.from_mapping(files), Names(dict.fromkeys(files["columns"], ""), {}))
    assert np.nanmax(data.grid.series[0].y) == 40


def test_a_comma_between_columns_is_no_decimal(tmp_path, capsys):
    path = tmp_path / "spring.csv"
    path.write_text("t,x\n" + "".join(f"{k / 50},{k % 7}\n" for k in range(200)))
    assert main(["inspect-data", str(path), "--output", str(tmp_path / "seen.png")]) == 0
    assert "decimal" not in yaml.safe_load(capsys.readouterr().out)["experiments"]["measured"]["data"]["files"]


@pytest.mark.parametrize(("system", "shared"), [("pendulum", ["omega0"]), (POINT_MASSES, [])])
def test_one_apparatus_has_one_value_of_what_is_a_constant_of_it(tmp_path, capsys, system, shared):
    """Initial speeds are none."""
    double = "double_pendulum" in system
    names = ["theta1", "theta2", "omega1", "omega2"] if double else ["theta", "omega"]
    rows = [[k / 50, *(np.cos(5.2 * k / 50 + j) for j in range(len(names)))] for k in range(1000)]
    path = tmp_path / "swings.csv"
    np.savetxt(path, rows, delimiter=",", header=",".join(["t", *names]), comments="")
    assert main(["inspect-data", str(path), "--system", system, "--output", str(tmp_path / "seen.png")]) == 0
    one = yaml.safe_load(capsys.readouterr().out)["experiments"]["measured"]
    assert list(one.get("refinement", {}).get("units", {})) == shared
    assert ("least_squares_shared" in one["methods"]) == bool(shared)


@pytest.mark.parametrize(
    ("row", "column", "cell", "message"),
    [
        (9, 0, "noon", "row 9, column t: 'noon' is no number"),
        (9, 1, "1.2 mm", "row 9, column x: '1.2 mm' is no number; write units in the header"),
        (9, 1, "12:30", "row 9, column x: '12:30' is no number; for dates and times set"),
        (9, 1, "0.5±0.1", "row 9, column x: '0.5±0.1' is no number; expected a number"),
        (1, 0, "x", "two columns are called 'x'"),
    ],
)
def test_one_bad_cell_is_told_and_changes_no_columns_meaning(tmp_path, capsys, row, column, cell, message):
    lines = ["t,x", *(f"{k / 50},{k % 7}" for k in range(200))]
    cells = lines[row - 1].split(",")
    cells[column] = cell
    lines[row - 1] = ",".join(cells)
    path = tmp_path / "spring.csv"
    path.write_text("\n".join(lines) + "\n")
    assert main(["inspect-data", str(path), "--output", str(tmp_path / "seen.png")]) == 2
    told = capsys.readouterr().err
    assert message in told and len(told.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("cell", "message"), [("{:.3f}°", "'1.000°' is no number; write units"), ("{:.2f}±0.1", "'1.00±0.1' is no number")]
)
def test_where_no_column_holds_numbers_a_cell_is_named(tmp_path, capsys, cell, message):
    path = tmp_path / "spring.csv"
    path.write_text("t,x\n" + "".join(f"{k / 50},{cell.format(k + 1)}\n" for k in range(200)))
    assert main(["inspect-data", str(path), "--output", str(tmp_path / "seen.png")]) == 2
    assert f"row 2, column x: {message}" in capsys.readouterr().err


KINETICS = """
import torch
from expertaug.systems import Parameter, System

class Kinetics(System):
    state = (Parameter("gut", "mg"), Parameter("conc", "mg/L"))
    expert_parameters = (Parameter("k", "1/s"),)

    def expert(self, t, y, z_e):
        taken = z_e[..., 0] * y[..., 0]
        return torch.stack((-taken, taken), dim=-1)
"""


@pytest.mark.parametrize(("dose", "used"), [("Dose (mg)", False), ("gut (mg)", True)])
def test_a_dose_that_every_row_repeats_is_no_motion(tmp_path, monkeypatch, capsys, dose, used):
    (tmp_path / "a_drugs").mkdir()
    (tmp_path / "a_drugs" / "kinetics.py").write_text(KINETICS)
    monkeypatch.syspath_prepend(tmp_path)
    rows = [(s, 10 + s, k, (10 + s) * (1 - 0.8**k)) for s in range(6) for k in range(20)]
    path = tmp_path / "doses.csv"
    np.savetxt(path, rows, delimiter=",", header=f"subject,{dose},t,serum (mg/L)", comments="", fmt="%.6g")
    given = ["--system", "a_drugs.kinetics", "--trajectory", "subject", "--output", str(tmp_path / "seen.png")]
    assert main(["inspect-data", str(path), *given]) == 0
    told = capsys.readouterr().out
    columns = yaml.safe_load(told)["experiments"]["measured"]["data"]["files"]["columns"]
    assert ("gut" in columns) == used, "only its name says that it is the component"
    assert "the same in all rows of a trajectory" in told
    assert columns.get("conc", {"name": "serum (mg/L)"})["name"] == "serum (mg/L)"
    assert ("leave the other cells empty" in told) == used


@pytest.mark.parametrize(
    ("count", "rows", "whole", "length", "caution"),
    [
        (2, 10, True, 5, "too short for a split by time, trains; the other's first half validates and its second"),
        (2, 30, True, 15, "scores depend on it alone"),
        (2, 60, False, 8, "the test set is the end of each trajectory"),
        (3, 12, True, 12, "there are only 3: 1 for validation, 1 for the test, on which scores depend"),
        (8, 12, True, 12, "there are only 8: 2 for validation, 1 for the test, on which scores depend"),
    ],
)
def test_few_or_short_trajectories_are_split_between_them_with_a_caution(
    tmp_path, capsys, monkeypatch, count, rows, whole, length, caution
):
    monkeypatch.setattr(Inspection, "draw", lambda *_: None)
    path = tmp_path / "short.csv"
    lines = [f"{k},{n / 10},{np.cos(n / 5 + k):.4f}" for k in range(count) for n in range(rows)]
    path.write_text("\n".join(["trial,t,theta", *lines, ""]))
    assert main(["inspect-data", str(path), "--system", "pendulum"]) == 0
    out = capsys.readouterr().out
    assert caution in next(line for line in out.splitlines() if " split: " in line)
    files = yaml.safe_load(out)["experiments"]["measured"]["data"]["files"]
    assert files["split"] == ({"by": "random", "pieces": "trajectories"} if whole else {"by": "time"})
    assert files["length"] == length
    sets, _, _ = sets_of(measure(MeasurementSettings.from_mapping(files), NAMES))
    assert all(len(trajectories) for trajectories in sets.values())
