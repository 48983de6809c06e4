"""Tables of driven systems: known inputs from columns, at every point of a chunk."""

import json

import numpy as np
import pytest
from swings import table

import expertaug as ea
from expertaug import systems
from expertaug.config import load as config
from expertaug.errors import InputError, InputErrors
from expertaug.inference.adaptive_prior import run_stage as own_prior
from expertaug.inference.settings import FirstPriorJob
from expertaug.learning.settings import Build
from expertaug.models.fit_settings import RefinementSettings
from expertaug.models.settings import PartsSettings
from expertaug.presets import resolve
from expertaug.runs.own_classes import check_classes
from expertaug.systems.base import Parameter

T = np.arange(41) * 0.05
COLUMNS = {"columns": {"theta": "angle"}, "inputs": {"torque": {"name": "drive", "factor": 0.1}}, "trajectory": "trial"}
START = {"omega": [-3.0, 3.0]}
SYSTEM = ea.DrivenPendulum()


class Weighed(ea.DrivenPendulum):
    covariates = (Parameter("mass", "kg"),)


@pytest.fixture(scope="module")
def truth():
    ranges = {"omega0": (1.0, 3.0)}, {"gamma": (0.0, 0.3)}
    return ea.simulate(SYSTEM, *ranges, inputs={"A": (0.5, 2.0), "f": (0.2, 0.8)}, n=12, t=T, name="tables")


def written(folder, truth, **columns):
    """A row a time of every trajectory, angles and ten times the torque."""
    trial, t = np.repeat(np.arange(len(truth)), len(T)), np.tile(T, len(truth))
    rows = {"trial": trial, "t": t, "angle": truth.y[..., 0].ravel(), "drive": 10 * truth.u[..., 0].ravel()}
    return table(folder / "driven.csv", rows | columns)


def test_inputs_lie_beside_their_states(truth, tmp_path):
    found = ea.read_measurements(str(written(tmp_path, truth)), SYSTEM, length=41, **COLUMNS)
    assert np.allclose(found.u, truth.u, atol=1e-5) and np.allclose(found.y[..., 0], truth.y[..., 0])
    assert found.mask[..., 0].all() and not found.mask[..., 1].any()
    coarse = ea.read_measurements(str(written(tmp_path, truth)), SYSTEM, length=11, step_s=0.1, stride=10, **COLUMNS)
    assert np.allclose(coarse.u[0, :, 0], truth.u[0, :22:2, 0], atol=1e-5)


def test_a_chunk_that_lacks_an_input_is_left_out(truth, tmp_path):
    drive = 10 * truth.u[..., 0].ravel()
    drive[3] = np.nan
    file = str(written(tmp_path, truth, drive=drive))
    found = ea.read_measurements(file, SYSTEM, length=41, **COLUMNS)
    assert len(found) == len(truth) - 1 and np.isfinite(found.u).all()
    shorter = ea.read_measurements(file, SYSTEM, length=20, stride=20, **COLUMNS)
    assert len(shorter) == 2 * len(truth) - 1


def test_a_covariate_is_known_at_all_times_of_its_trajectory(truth, tmp_path):
    """Its cells may be empty, and points without a row have none."""
    weight = np.repeat(1.0 + np.arange(len(truth)), len(T))
    weight[np.tile(np.arange(len(T)) > 0, len(truth))] = np.nan
    settings = COLUMNS | {"inputs": COLUMNS["inputs"] | {"mass": "mass"}}
    file = str(written(tmp_path, truth, mass=weight))
    found = ea.read_measurements(file, Weighed(), length=41, **settings)
    assert len(found) == len(truth)
    assert (found.u[..., 1] == 1.0 + np.arange(len(truth))[:, None]).all()


def test_between_uneven_rows_they_are_straight_lines(truth, tmp_path):
    kept = np.tile(np.arange(len(T)) % 3 != 1, len(truth))
    trial, t = np.repeat(np.arange(len(truth)), len(T)), np.tile(T, len(truth))
    drive, angle = 3 * t + trial, truth.y[..., 0].ravel()
    rows = {"trial": trial[kept], "t": t[kept], "angle": angle[kept], "drive": drive[kept]}
    file = str(table(tmp_path / "driven.csv", rows))
    found = ea.read_measurements(file, SYSTEM, length=40, uneven="interpolate", step_s=0.05, min_seen=0.5, **COLUMNS)
    assert len(found) and np.allclose(found.u[..., 0] - found.u[:, :1, 0], 0.3 * T[:40], atol=1e-5)


@pytest.mark.parametrize(
    ("system", "change", "message"),
    [
        (SYSTEM, {"inputs": {}}, "inputs.torque: missing, the system is driven by it"),
        (SYSTEM, {"inputs": {"force": "drive"}}, "inputs.force: 'force' is no known input"),
        (SYSTEM, {"inputs": {"torque": "push"}}, "no column 'push'"),
        (ea.DampedPendulum(), {}, "inputs.torque: 'torque' is no known input; known: none"),
        (Weighed(), {"inputs": {"torque": "drive", "mass": "t"}}, "inputs.mass: mass changes along"),
    ],
)
def test_what_cannot_be_used_is_one_line(truth, tmp_path, system, change, message):
    with pytest.raises(InputError, match=message):
        ea.read_measurements(str(written(tmp_path, truth)), system, length=41, **COLUMNS | change)


def test_inputs_that_hold_their_values_are_not_interpolated(truth, tmp_path):
    class Held(ea.DrivenPendulum):
        interpolation = "constant"

    assert systems.names(Held()).held and not systems.names(SYSTEM).held
    with pytest.raises(InputError, match="uneven: interpolate, the system's inputs hold"):
        ea.read_measurements(str(written(tmp_path, truth)), Held(), length=41, uneven="interpolate", **COLUMNS)


def test_such_sets_are_learned_from_and_find_their_own_prior(truth, tmp_path):
    split = {"by": "random", "pieces": "trajectories"}
    sets = ea.split_measurements(str(written(tmp_path, truth)), SYSTEM, length=41, split=split, **COLUMNS)
    for name, one in sets.items():
        one.save(tmp_path / f"{name}.npz")
    prior = {"omega0": (0.5, 4.0)}
    fitted = ea.least_squares(SYSTEM, sets["train"], observed_s=1.0, prior=prior, start=START, starts=32, noise=0.01)
    window = sets["test"].seen[:, : fitted.observed]
    found = fitted.forecast(window, sets["test"].t, u=sets["test"].u)
    assert np.isfinite(found.y).all() and np.median(found.chi2) < 100
    job = FirstPriorJob(
        experiment="driven",
        method="least_squares",
        label="",
        preset="corrected",
        system={"name": "driven_pendulum"},
        build=Build(kind="least_squares", interaction=False),
        model=PartsSettings(),
        t1_s=1.0,
        start=START,
        choices=resolve("corrected"),
        seeds=[0],
        windows=["test"],
        budget=2.0,
        noise={"theta": 0.01},
        refinement=RefinementSettings(),
    )
    told = own_prior(None, tmp_path, tmp_path / "prior.json", job)
    assert json.loads((tmp_path / "prior.json").read_text())["ranges"]["omega0"] == list(told.ranges["omega0"])


CONFIG = """
run: [driven]
experiments:
  driven:
    system: {{name: driven_pendulum}}
    data:
      source: files
      t1_s: 1.0
      start: {{omega: [-3, 3]}}
      files:
        paths: {path}
        trajectory: trial
        columns: {{theta: angle}}
        {inputs}
        length: 41
        stride: 20
        evaluation_stride: 20
        min_chunks: 1
    model: {{encoder: {{kind: recurrent}}, interaction: {{kind: mlp}}}}
    training: {{epochs: 1}}
    methods: [mean]
"""


def test_a_configuration_names_their_columns(truth, tmp_path):
    file = tmp_path / "mine.yaml"

    def validated(inputs):
        file.write_text(CONFIG.format(path=written(tmp_path, truth), inputs=inputs))
        return config.validate(config.load([*config.default_files(), file]))

    found = validated("inputs: {torque: drive}")
    assert check_classes(found) and found.experiments["driven"].data.files.inputs == {"torque": "drive"}
    for inputs, message in (
        ("", "inputs.torque: missing, the system is driven by it"),
        ("inputs: {torque: drive, force: drive}", "'force' is no known input of the system"),
        ("inputs: {torque: push}", "has no column 'push'"),
    ):
        with pytest.raises(InputErrors, match=message):
            validated(inputs)
