"""What a logger writes of a swing, as texts, and what inspect-data makes of them."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from swings import NAMES, swing

from expertaug.cli import main
from expertaug.measurements.cut import measure
from expertaug.measurements.settings import MeasurementSettings

T = 0.05 * np.arange(400)
Y = swing(1.0, points=400) + 0.005 * np.random.default_rng(0).standard_normal((400, 2))


@pytest.fixture
def inspected(tmp_path, capsys):
    """What is said of a text file, and the block ``data`` that is proposed."""

    def look(text: str, *options: str, status: int = 0, system: str = "pendulum"):
        path = tmp_path / "a.csv"
        path.write_text(text)
        picture = ["--output", str(tmp_path / "x.png")]
        assert main(["inspect-data", str(path), "--system", system, *picture, *options]) == status
        told = capsys.readouterr()
        if status:
            return told.err, None
        return told.out, yaml.safe_load(told.out)["experiments"]["measured"]["data"]

    return look


def csv(theta=Y[:, 0], omega=Y[:, 1], t=T, header="t,theta,omega", form="{:.5f}"):
    cells = [
        [one if isinstance(one, str) else form.format(one) for one in row] for row in zip(t, theta, omega, strict=True)
    ]
    return "\n".join([header, *map(",".join, cells)]) + "\n"


def rows_of(data):
    return measure(MeasurementSettings.from_mapping(data["files"]), NAMES).grid.series[0].rows
