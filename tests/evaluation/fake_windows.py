"""Made-up forecasts of single windows whose answer is known: files of them, and the same in memory."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug.evaluation.distance import beyond
from expertaug.evaluation.forecasts import Forecasts, SetForecasts, VersionKey
from expertaug.evaluation.settings import WindowStudyJob

N = 400
RANGE = {"omega0": [1.5, 3.1]}
LABELS = [("a", "A"), ("a+~flow", "A+ flow")]


def asked(labels=LABELS, **more):
    return WindowStudyJob(labels=labels, hues=[("a", 0)], **more)


def curves(labels=LABELS, **more):
    return asked(labels, training_range=RANGE, **more)


def fake(path, method, seeds, width=1.0, failing=0.5, spoiled=None):
    """Windows whose error grows with the distance, and whose misfit tells which forecasts fail."""
    random = np.random.default_rng([len(method), *seeds])
    arrays = {"version": np.array(["e", "corrected", method]), "seeds": np.array(seeds), "failed": np.array([], int)}
    arrays |= {"t": np.arange(3.0), "observed": np.array(1), "state_names": ["theta"], "state_units": ["rad"]}
    arrays |= {"parameter_names": ["omega0"], "parameter_units": ["rad/s"], "rank_draws": np.array(119)}
    for name, (low, high) in {"validation": (1.5, 3.1), "iid": (1.5, 3.1), "test": (0.5, 1.5)}.items():
        z_e = np.random.default_rng(len(name)).uniform(low, high, (N, 1))
        away = beyond(z_e, ["omega0"], RANGE)
        bad = away > failing
        misfit = 1e-4 * (1 + random.random((len(seeds), N))) + 1e-2 * bad
        arrays[f"{name}_z_e"] = z_e
        arrays[f"{name}_errors"] = 1e-3 * (1 + random.random((len(seeds), N))) + bad
        arrays[f"{name}_misfit"] = misfit
        arrays[f"{name}_z_e_hat"] = z_e + 0.01 * random.standard_normal((len(seeds), N, 1))
        if width:
            draws = random.standard_normal((119, len(seeds), N)) * width
            arrays[f"{name}_ranks"] = (draws < random.standard_normal((len(seeds), N))).sum(0)[..., None]
            arrays[f"{name}_tarp"] = random.integers(0, 120, (len(seeds), N))
            arrays[f"{name}_inside"] = np.broadcast_to([0.4, 0.8], (len(seeds), 30, 2))
    if width:
        arrays |= {f"own_{key}": arrays[f"iid_{key}"] for key in ("ranks", "tarp", "inside")}
    arrays |= spoiled or {}
    np.savez(path, **arrays)
    return path


@pytest.fixture
def files(tmp_path):
    made = [("a", [0], None), ("a", [1], None), ("a+~flow", [0], 1.0), ("a+~flow", [1], 1.0)]
    return [fake(tmp_path / f"{k}.npz", method, seeds, width) for k, (method, seeds, width) in enumerate(made)]


SEEDS = [0, 1]


def forecasts(method: str = "a", experiment: str = "e") -> Forecasts:
    """Of windows whose misfit tells which forecasts fail."""
    random, sets = np.random.default_rng(0), {}
    for name, (low, high) in {"validation": (1.5, 3.1), "iid": (1.5, 3.1), "test": (0.5, 1.5)}.items():
        z_e = random.uniform(low, high, (N, 1))
        bad = 1.0 * (z_e[:, 0] < 0.8)
        noise = random.random((len(SEEDS), N))
        sets[name] = SetForecasts(
            errors=1e-3 * (1 + noise) + bad,
            misfit=1e-4 * (1 + noise) + 1e-2 * bad,
            z_e=z_e,
            z_e_hat=z_e + 0.01 * random.standard_normal((len(SEEDS), N, 1)),
            ranks=random.integers(0, 120, (len(SEEDS), N, 1)),
            tarp=random.integers(0, 120, (len(SEEDS), N)),
        )
    return Forecasts(
        t=np.arange(3.0),
        observed=1,
        seeds=SEEDS,
        state_names=["theta"],
        state_units=["rad"],
        parameter_names=["omega0"],
        parameter_units=["rad/s"],
        sets=sets,
        version=VersionKey(experiment, "corrected", method),
        rank_draws=119,
    )
