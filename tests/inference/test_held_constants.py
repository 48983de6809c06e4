"""Alternation where windows share parameters: the constants, their seeds, what a file holds, and resuming."""

import json
import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from rubbed_pendulum import END, EXPERIMENT, NOISE, Rubbed, T, swings

import expertaug as ea
from expertaug.cli import main
from expertaug.config import load as config
from expertaug.config import stage_settings
from expertaug.inference import alternating
from expertaug.inference.flow_training import given_what_is_shared
from expertaug.inference.held_constants import HeldConstants
from expertaug.inference.shared import fit_shared_of_seeds
from expertaug.models import store
from expertaug.models.decoder import Decoder
from expertaug.models.fit_settings import Constant, Refinement, RefinementSettings, SensorConstants
from expertaug.models.sensors import Sensors
from expertaug.trajectories import Trajectories

ROOT = Path(__file__).parents[2]
F_A = {"kind": "mlp", "layers": [8], "activation": "silu", "components": ["omega"]}
OPTIONS = {"steps": 120, "latent": 0, "validate_every": 30, "solver": {"method": "rk4", "substeps": 1}}
PRIOR = {"omega0": (1.0, 3.0)}


def seen(n, seed, scale=1.0):
    """Windows of one pendulum with friction, of which the expert knows nothing; a speed that a sensor scales."""
    data = swings(n, seed)
    return replace(data, z_e=data.z_e[:, :1], y=data.y * np.array([1.0, scale], dtype=np.float32))


def learned(train, seeds=(0, 1), refinement=None, **options):
    how = {"units": {"omega0": "shared"}} | (refinement or {})
    sets = train, seen(10, 99)
    given = OPTIONS | options
    return ea.alternate(
        ea.DampedPendulum(), F_A, *sets, observed_s=END, prior=PRIOR, noise=NOISE, seeds=seeds, refinement=how, **given
    )


@pytest.fixture(scope="module")
def model():
    """Of a training too short for a good term, and of fits that are not at their ends."""
    quick = {"starts": 4, "tries": 1, "steps": 4}
    return learned(seen(16, 1), steps=6, validate_every=6, refinement=quick)


@pytest.fixture(scope="module")
def trained():
    return learned(seen(16, 1))


@pytest.mark.slow
def test_one_frequency_is_found_beside_a_learned_friction(trained):
    """Better than without the learned term, and each seed states a value of its own."""
    one = trained.stored.card.refinement.shared["omega0"]
    assert len(one.seeds) == 2 and one.value == pytest.approx(np.mean(one.seeds))
    assert one.seeds == pytest.approx([1.7, 1.7], rel=0.02)
    assert one.error == pytest.approx(np.hypot(one.std, abs(one.seeds[0] - one.seeds[1]) / 2))
    test = seen(20, 5)
    alone = ea.least_squares(
        ea.DampedPendulum(), seen(16, 1), observed_s=END, prior=PRIOR, noise=NOISE, units={"omega0": "shared"}
    )
    error = {name: each.evaluate(test) for name, each in (("learned", trained), ("alone", alone))}
    log = {name: each[each.metric == "log_mse_sum"].value.max() for name, each in error.items()}
    assert log["learned"] < log["alone"] - 1
    rows = trained.estimates(test)
    assert list(rows["of"]) == ["all windows (shared)"] and rows["error"].iloc[0] > 0
    assert rows["value"].iloc[0] == pytest.approx(one.value, rel=1e-6)


def test_each_seed_holds_its_own_constant(model, tmp_path):
    """In estimates, alone, and from a file."""
    test, t, one = seen(6, 7), T[:16], model.stored.card.refinement.shared["omega0"]
    window = test.seen[:, : model.observed]
    found = model.estimate(window, T[: model.observed])["omega0"]
    np.testing.assert_allclose(found, np.array(one.seeds)[:, None] * np.ones((1, 6)), rtol=1e-6)
    second = model[1]
    assert second.stored.card.refinement.shared["omega0"].seeds == one.seeds[1:]
    whole = model.forecast(window, t)
    np.testing.assert_allclose(second.forecast(window, t).y, whole.y[1], atol=1e-5)
    model.save(tmp_path / "model.safetensors")
    np.testing.assert_array_equal(ea.load(tmp_path / "model.safetensors").forecast(window, t).y, whole.y)


@pytest.mark.slow
def test_windows_of_another_pendulum_are_fitted_together_with_each_seeds_own_term(trained):
    other = swings(10, seed=4, omega0=1.3)
    other = replace(other, z_e=other.z_e[:, :1])
    moved = trained.together(other)
    one = moved.refinement.shared["omega0"]
    assert one.seeds == pytest.approx([1.3, 1.3], rel=0.02)
    log = {name: each.evaluate(other) for name, each in (("as trained", trained), ("together", moved))}
    errors = {name: each[each.metric == "log_mse_sum"].value.max() for name, each in log.items()}
    assert errors["together"] < errors["as trained"] - 1


@pytest.mark.slow
def test_ranges_are_found_and_a_name_that_is_none_is_refused():
    sets, short = (seen(12, 1), seen(8, 2)), OPTIONS | {"steps": 20}
    options = {"observed_s": END, "noise": NOISE, **short}
    found = ea.alternate(ea.DampedPendulum(), F_A, *sets, refinement={"units": {"omega0": "shared"}}, **options)
    low, high = found.refinement.prior["omega0"]
    assert low < 1.7 < high and found.refinement.shared["omega0"].value == pytest.approx(1.7, rel=0.1)
    with pytest.raises(ea.InputError, match="is no expert parameter"):
        ea.alternate(ea.DampedPendulum(), F_A, *sets, refinement={"units": {"mass": "shared"}}, **options)


def test_a_flow_knows_what_is_shared_but_for_its_error(model, tmp_path):
    """Whatever the window says, its draws are those of the constant; in estimates it is one value of all windows."""
    short = {"steps": 4, "batch_size": 16, "pool": 32, "held_out": 32, "samples": 19, "layers": [16], "hidden": [8]}
    flow = ea.fit_posterior(model, seen(8, 1), prior=PRIOR, noise=NOISE, **short)
    constant = model.refinement.shared["omega0"]
    width = math.sqrt(3) * math.hypot(constant.std, np.std(constant.seeds, ddof=1))
    assert flow.stored.card.prior["omega0"] == pytest.approx((constant.value - width, constant.value + width))
    window = seen(6, 7)
    found = flow.forecast(window.y[:, : flow.observed], T).z_e["omega0"]
    assert np.abs(found - constant.value).max() < 1.05 * width
    (row,) = flow.estimates(window).itertuples()
    assert (row.parameter, row.of) == ("omega0", "all windows (shared)") and 0 < row.error < 2 * width
    flow.save(tmp_path / "flow.safetensors")
    again = ea.load(tmp_path / "flow.safetensors").estimates(window)
    assert (again.value[0], again.of[0]) == (row.value, row.of)


def test_a_file_keeps_the_sensor_of_each_seed(tmp_path):
    """One constant of four that a sensor may have, of seeds of which one failed."""
    quick = {"sensors": {"theta": {"offset": "shared"}}, "starts": 4, "tries": 1, "steps": 4}
    found = learned(seen(16, 1), steps=6, validate_every=6, refinement=quick)
    found.save(tmp_path / "m.safetensors")
    again = ea.load(tmp_path / "m.safetensors").refinement.sensors["theta"]
    assert again.known == ["offset"] and again.offset.seeds == found.refinement.sensors["theta"].offset.seeds
    failed = replace(found.stored, card=found.stored.card.but(failed=[1]))
    fitted = fit_shared_of_seeds(failed, found.refinement, seen(16, 1)).sensors["theta"]
    assert fitted.offset.seeds[0] == fitted.offset.seeds[1] and fitted.known == ["offset"]


@pytest.mark.parametrize(("name", "ends"), [("omega0", (1e-7, 0.1 + 3**0.5)), ("bias", (0.1 - 3**0.5, 0.1 + 3**0.5))])
def test_a_constant_that_may_be_zero_is_drawn_below_it_only_where_it_may_be(model, name, ends):
    """A positive parameter and one that may be negative, as far off as they are large."""
    parameter = ea.Parameter(name, "rad/s", positive=name == "omega0")
    system = SimpleNamespace(expert_parameters=(parameter,))
    known = model.stored.card.refinement.model_copy(update={"shared": {name: Constant(value=0.1, std=1.0)}})
    stored = replace(model.stored, model=SimpleNamespace(system=system), card=model.stored.card.but(refinement=known))
    assert given_what_is_shared(stored, {name: (1.0, 3.0)})[name] == pytest.approx(ends)


def test_no_flow_knows_sensors(model):
    scale = SensorConstants.of(scale=Constant(value=0.9, std=0.1))
    sensed = model.stored.card.refinement.model_copy(update={"sensors": {"omega": scale}})
    other = replace(model, stored=replace(model.stored, card=model.stored.card.but(refinement=sensed)))
    with pytest.raises(ea.InputError, match="with constants of sensors"):
        ea.fit_posterior(other, seen(8, 1), prior=PRIOR, noise=NOISE)


@pytest.mark.slow
def test_the_scale_of_a_sensor_is_found_with_a_learned_term():
    found = learned(seen(16, 1, scale=0.9), refinement={"sensors": {"omega": {"scale": "shared"}}}, seeds=(0,))
    scale = found.stored.card.refinement.sensors["omega"].scale
    assert scale.value == pytest.approx(0.9, abs=0.01)
    test = seen(12, 5, scale=0.9)
    log = found.evaluate(test)
    assert log[log.metric == "log_mse_sum"].value.item() < -4
    assert Sensors.of(found.system, found.stored.card.refinement.sensors).scale.shape == (1, 1, 2)


@pytest.mark.slow
def test_windows_may_have_nothing_of_their_own():
    """Of noise-free windows whose first point is known, with one frequency and no z_a."""
    train = swings(12, 1, noise=0.0)
    train = replace(train, z_e=train.z_e[:, :1])
    found = ea.alternate(
        ea.DampedPendulum(), F_A, train, train, observed_s=END, prior=PRIOR, refinement={"units": {"omega0": "shared"}},
        **OPTIONS,
    )  # fmt: skip
    assert found.stored.card.refinement.shared["omega0"].value == pytest.approx(1.7, rel=0.1)


@pytest.mark.slow
def test_it_goes_on_to_the_same_bits_after_a_kill(tmp_path, monkeypatch):
    """As a stage, whose settings the configuration makes."""
    alternation = "{latent: 0, steps: 6, validate_every: 3, checkpoint_s: 0.0}"
    text = EXPERIMENT.replace("least_squares_shared]", "alternating_shared]").replace(
        "seeds: [0, 1]", "seeds: [0, 1, 2]"
    )
    text += f"    overrides: {{alternating_shared: {{alternation: {alternation}}}}}\n"
    (tmp_path / "mine.yaml").write_text(text)
    found = config.validate(config.load([*config.default_files(), tmp_path / "mine.yaml"]))
    for name, n in (("train", 8), ("validation", 6)):
        seen(n, n).save(tmp_path / f"{name}.npz")
    job = json.dumps(stage_settings.train(found, "swings", "alternating_shared", "seeds_0_1_2"))

    def run(name):
        paths = ["--data", str(tmp_path), "--output", str(tmp_path / f"{name}.safetensors")]
        return main(["alternate", *paths, "--work", str(tmp_path / name), "--settings", job])

    assert run("whole") == 0
    done = alternating.Alternation.step

    def killed(self):
        if self.step_ == 4:
            raise KeyboardInterrupt
        return done(self)

    monkeypatch.setattr(alternating.Alternation, "step", killed)
    assert run("resumed") not in (0, 2)
    monkeypatch.setattr(alternating.Alternation, "step", done)
    assert run("resumed") == 0
    one, other = (store.load(tmp_path / f"{name}.safetensors") for name in ("whole", "resumed"))
    assert one.card.kind == "alternating_shared" and one.card.refinement == other.card.refinement
    for key, value in one.model.state_dict().items():
        assert torch.equal(value, other.model.state_dict()[key]), key


def test_parameters_of_another_expert_are_known_by_their_names():
    data = Trajectories(T, swings(4).y, np.ones((4, 1)), np.full((4, 1), 0.3))
    known = data.with_parameters(["omega0"], ["alpha"], ["alpha", "omega0", "mass"]).z_e
    np.testing.assert_allclose(known, np.tile([0.3, 1.0, np.nan], (4, 1)), rtol=1e-6)
    assert [p.name for p in Rubbed().expert_parameters] == ["omega0", "alpha"]


def test_a_version_whose_expert_has_other_parameters_is_told_what_the_sets_know():
    found = config.validate(config.load([*config.default_files(), ROOT / "config" / "peers.yaml"]))
    of = {
        method: stage_settings.evaluate(found, "aphynity_pendulum", method, "seeds_0_1_2").get("known")
        for method in ("friction_shared", "alternating_shared", "least_squares")
    }
    assert of.pop("friction_shared") == {"z_e": ["omega0"], "z_a": ["alpha"]}
    assert set(of.values()) == {None}


def test_fits_hold_the_constants_of_the_expert_alone_at_first():
    rubbed, windows = ea.DampedPendulum(friction="estimated"), torch.randn(5, 1, 7, 2)
    settings = RefinementSettings.of(units={"alpha": "shared"}, sensors={"theta": {"offset": "shared"}})
    first = Refinement.of(
        settings=settings,
        noise=NOISE,
        prior=None,
        shared={"alpha": Constant(value=0.2, std=0.1)},
        sensors={"theta": SensorConstants.of(offset=Constant(value=0.3, std=0.1))},
    )
    held, kept = HeldConstants.of(rubbed, lambda decoder: None, first, windows, 3), []
    assert held.parameters == [1] and held.values.shape == (3, 2)
    fit = SimpleNamespace(decoder=Decoder(rubbed), hold=lambda *told: kept.append(told))
    held.hold([fit])
    ((places, coordinates),) = kept
    assert places == [1] and coordinates.shape == (1, 1), "all seeds share a decoder without parameters"
    assert coordinates.exp().item() * rubbed.expert_parameters[1].scale == pytest.approx(0.2)
    assert fit.decoder.sensors.offset.flatten().tolist() == pytest.approx([0.3, 0.0])
    assert fit.decoder.sensors.scale.flatten().tolist() == [1.0, 1.0]
