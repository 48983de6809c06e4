"""Runs beside each other, as the wells of a plate, are put below each other."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
import yaml

import expertaug as ea
from expertaug.cli import main
from expertaug.errors import InputError
from expertaug.measurements.layout import recognise
from expertaug.measurements.reshape import put_below
from expertaug.measurements.settings import Beside, Pivot, TableKeys
from expertaug.measurements.table_files import read_table
from expertaug.systems.base import Parameter, System

T = np.arange(0, 24.1, 0.5)


class Growth(System):
    state = (Parameter("od", ""),)
    expert_parameters = (Parameter("r", "1/h"), Parameter("K", ""))

    def expert(self, t, y, z_e):
        r, k = z_e.unbind(-1)
        return (r * y[..., 0] * (1 - y[..., 0] / k)).unsqueeze(-1)


def grown(rate):
    return 1.2 / (1 + 40 * np.exp(-rate * T))


def plate(path, names, time="Time [h]", more=None):
    """A column of times, one for each name, and one more; run k grows at a rate of .4 + .05 k."""
    columns = {time: T} | {name: grown(0.4 + 0.05 * k) for k, name in enumerate(names)} | (more or {})
    lines = [
        ",".join(columns),
        *(",".join(f"{value:.6g}" for value in row) for row in zip(*columns.values(), strict=True)),
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_rows_of_each_run_follow_those_of_the_one_before(tmp_path):
    path = plate(tmp_path / "plate.csv", ["A1", "A2", "B1"], more={"temperature": 37 + 0 * T})
    table = read_table(path, TableKeys(beside=Beside(columns=["A1", "B1"], value="od")))
    assert table.names == ["Time [h]", "A2", "temperature", "run", "od"] and len(table) == 2 * len(T)
    assert table.texts("run")[[0, len(T) - 1, len(T)]].tolist() == ["A1", "A1", "B1"]
    assert table.numbers("od") == pytest.approx(np.concatenate((grown(0.4), grown(0.5))), abs=1e-5)
    assert table.line.tolist() == 2 * list(range(2, len(T) + 2)), "an editor's lines"


def test_what_cannot_be_put_below_is_refused(tmp_path):
    path = plate(tmp_path / "plate.csv", ["A1", "A2", "run"])
    with pytest.raises(InputError, match=r"no column 'A9'"):
        read_table(path, TableKeys(beside=Beside(columns=["A1", "A9"], value="od")))
    with pytest.raises(InputError, match="run"):
        put_below(read_table(path, TableKeys()), Beside(columns=["A1", "A2"], value="od"))


@pytest.mark.parametrize(
    ("names", "more", "found"),
    [
        (["A1", "A2", "H12"], {}, True),
        (["od_rep1", "od_rep2", "od_rep3"], {"temp": 37 + T}, True),
        (["Subject 1", "Subject 2", "Subject 10"], {}, True),
        (["A1", "A2"], {}, False),  # two may be two of anything
        (["temp1", "temp2", "temp3"], {"od": grown(0.4)}, False),
        (["temp1", "temp2", "temp3"], {"trial": 0 * T}, False),
    ],
)
def test_runs_are_recognised_by_their_names(tmp_path, names, more, found):
    layout = recognise(plate(tmp_path / "a.csv", names, more=more), None, "od", (None, None))
    assert ("beside" in layout.keys) is found
    if found:
        assert layout.keys["beside"]["columns"] == names and "--set beside=null" in layout.remarks[-1]
    assert "beside" not in recognise(tmp_path / "a.csv").keys, "of several components each may be one"
    assert "beside" not in recognise(tmp_path / "a.csv", {"beside": None}, "od").keys


def test_a_unit_of_all_of_them_is_that_of_their_values(tmp_path):
    path = plate(tmp_path / "a.csv", [f"conc {k} (mg/L)" for k in (1, 2, 3)])
    assert recognise(path, None, "conc").keys["beside"]["value"] == "conc [mg/L]"


def test_a_plate_becomes_trajectories_with_times_as_the_system_has_them(tmp_path, capsys, monkeypatch):
    plate(tmp_path / "plate.csv", ["A1", "A2", "A3", "B1"])
    (tmp_path / "growth_of.py").write_text(
        f"from expertaug.systems.base import Parameter, System\n\n\n{inspect.getsource(Growth)}"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert main(["inspect-data", "plate.csv", "--system", "growth_of:Growth"]) == 0
    out = capsys.readouterr().out
    assert "4 columns, 'A1' to 'B1', are taken for a run of od each" in out
    assert "times are in h and r is in 1/h: they stay as they are (unit: s), so read h" in out
    assert "times are converted" not in out
    files = yaml.safe_load(out)["experiments"]["measured"]["data"]["files"]
    assert files["time"] == {"name": "Time [h]", "unit": "s"} and files["trajectory"] == "run"
    (tmp_path / "mine.yaml").write_text(out)
    assert main(["validate", "mine.yaml"]) == 0
    lab = {key: files[key] for key in ("beside", "time", "trajectory", "columns")}
    chunks = ea.read_measurements("plate.csv", Growth(), **lab, length=len(T))
    prior = {"r": (0.1, 2.0), "K": (0.3, 3.0)}
    model = ea.least_squares(Growth(), chunks, observed_s=12.0, prior=prior, noise=1e-3, starts=8, tries=1)
    found = model.forecast(chunks.seen[:, : model.observed], chunks.t).z_e["r"]
    assert found == pytest.approx([0.4, 0.45, 0.5, 0.55], rel=0.01)


def test_a_sensors_second_value_of_one_moment_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("sensor,t,value\na,0,1\nb,0,2\na,0,3\n")
    with pytest.raises(InputError, match="row 4: another row has sensor a at t 0"):
        read_table(path, TableKeys(pivot=Pivot(name="sensor", value="value")))
