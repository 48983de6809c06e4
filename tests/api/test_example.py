"""The example of the README runs as it is written."""

import runpy
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "docs/example.py"


def test_it_prints_a_table_in_which_augmentation_helps(capsys):
    names = runpy.run_path(str(EXAMPLE))
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    table = {row[0]: [float(value) for value in row[1:]] for row in rows if len(row) == 3 and row[0] != "label"}
    assert ["label", "APHYNITY", "APHYNITY+"] in rows
    assert table["log_mse_sum"][1] < table["log_mse_sum"][0] - 0.5
    assert table["rmse_omega0"][1] < table["rmse_omega0"][0]
    assert table["relative_error"][1] < table["relative_error"][0]
    assert names["out"].y.shape == (50, 101, 2) and names["out"].z_e["omega0"].shape == (50,)
    lines = EXAMPLE.read_text(encoding="utf-8").splitlines()[1:]
    assert len([line for line in lines if line.strip()]) == 12
