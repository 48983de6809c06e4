"""The names that `import expertaug` gives, and what they refuse."""

import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_pendulum import SEEN, T

import expertaug as ea

ROOT = Path(__file__).parents[2]


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, expertaug as ea; dir(ea); print(*sorted({m.split('.')[0] for m in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"torch", "numpy", "pandas", "matplotlib", "scipy", "mlflow", "pydantic"} & set(done.stdout.split())


def test_every_name_is_there_and_has_a_type():
    stub = ast.parse((ROOT / "src/expertaug/__init__.pyi").read_text(encoding="utf-8"))
    typed = {}
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            typed |= {alias.asname or alias.name: f"{node.module}:{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Assign):
            assert set(ast.literal_eval(node.value)) == {"__version__", *ea._EXPORTS}
    assert typed.keys() == ea._EXPORTS.keys()
    for name, where in ea._EXPORTS.items():
        assert typed[name] == where if ":" in where else typed[name].replace(":", ".") == where
        assert getattr(ea, name) is not None and name in dir(ea)
    with pytest.raises(AttributeError, match="fitt"):
        _ = ea.fitt


def test_options_of_flows_and_alternation_are_those_of_their_settings():
    from expertaug.api.inference import AlternatingOptions
    from expertaug.api.posterior import FlowOptions
    from expertaug.inference.settings import AlternatingSettings, FlowSettings

    for options, settings in ((FlowOptions, FlowSettings), (AlternatingOptions, AlternatingSettings)):
        assert set(options.__annotations__) == set(settings.model_fields) - {"checkpoint_s"}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"z_e": {"omega": (1, 2)}}, "parameter ranges"),
        ({"n": 0}, "n = 0"),
        ({"t": [0, 0]}, "t has shape"),
        ({"noise": -0.1}, "noise = -0.1"),
        ({"noise": "x"}, "noise = x; .* noise at least 0"),
        ({"n": "3"}, "n = 3"),
        ({"seed": -1}, "seed: found -1; give a whole number from 0 on"),
    ],
)
def test_what_cannot_be_simulated_is_one_line(change, expected):
    options = {"z_e": SEEN, "z_a": {"alpha": (0, 1)}, "n": 2, "t": T} | change
    with pytest.raises(ea.InputError, match=expected):
        ea.simulate(ea.DampedPendulum(), **options)


def test_what_is_shown_of_a_result_is_one_line():
    """As a notebook shows what stands alone in a cell, whatever the arrays hold."""
    pendulum, t = ea.DampedPendulum(), np.arange(41) * 0.1
    train = ea.simulate(pendulum, {"omega0": (1.5, 3.1)}, {"alpha": (0.0, 0.3)}, n=6, t=t, noise=0.01)
    model = ea.least_squares(
        pendulum, train, observed_s=2.0, prior={"omega0": (1.0, 4.0)}, noise=0.01, starts=4, tries=1
    )
    windows = train.y[:3, : model.observed]
    shown = {
        "Trajectories(6 of 0, 0.1 … 4 s (41 points), states of 2 numbers)": train,
        "Forecast(3 windows, 0, 0.1 … 4 s (41 points), seed 0, estimates of omega0": model.forecast(windows, t),
        "Band(0, 0.1 … 4 s (41 points), quantiles ": ea.predictive(model, windows, t),
        "Equation(": ea.explain(model, train, train, max_samples=6),
        "Comparison(": ea.compare({"damped": pendulum, "again": pendulum}, train, observed_s=2.0, noise=0.01),
    }
    for begins, result in shown.items():
        assert repr(result).startswith(begins) and "\n" not in repr(result) and len(repr(result)) < 300
    group = model.forecast(windows, t)
    assert repr(replace(group, z_e={}, seeds=[0, 1], y=np.stack((group.y,) * 2))).startswith("Forecast(3 windows")
