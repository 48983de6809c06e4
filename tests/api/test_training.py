"""Training, augmentation and fine-tuning in memory: what they keep, and what they refuse."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import torch
from small_pendulum import OPTIONS, SHIFTED, T

import expertaug as ea


def test_training_options_are_those_of_the_trainer():
    from expertaug.api.training import TrainingOptions
    from expertaug.learning.settings import TrainSettings

    given_otherwise = {"checkpoint_s", "objective", "solver", "horizon_s"}
    assert set(TrainingOptions.__annotations__) == set(TrainSettings.model_fields) - given_otherwise


def test_classes_and_mappings_make_the_same_model(sets, recipe, fit):
    encoder = partial(ea.RecurrentEncoder, hidden=8, layers=[8])
    other = ea.HybridModel(ea.DampedPendulum(), encoder, partial(ea.MLPInteraction, layers=(6, 6)))
    again = ea.fit(other, sets["train"], sets["validation"], observed_s=1.0, seeds=(0, 1), **OPTIONS)
    first, second = (model.stored.model.state_dict() for model in (fit, again))
    assert all(torch.equal(first[k], second[k]) for k in first)
    assert again.stored.card.model.encoder["kind"] == "recurrent"


def test_the_course_of_the_training_is_kept(fit):
    loss = fit.history[fit.history["metric"] == "loss"]
    assert list(loss["seed"]) == [0, 1] * OPTIONS["epochs"] and np.isfinite(loss["value"]).all()
    assert {"validation_score", "learning_rate"} <= set(fit.history["metric"])


class TestRefusals:
    @pytest.mark.parametrize(
        ("options", "expected"),
        [
            ({"observed_s": 9.0}, "observed_s: found 9.0; the data's times are 0, 0.1 … 2 s"),
            ({"observed_s": 0.0}, "observed_s"),
            ({"epoch": 3}, "training.*epoch"),
            ({"seeds": []}, "seeds: found"),
            ({"seeds": [1, 1]}, "seeds: found"),
            ({"seeds": 3}, "seeds: found 3"),
            ({"seeds": [-1]}, "seeds: found"),
            ({"seeds": [0.5]}, r"seeds: found \[0.5\]; give whole numbers"),
            ({"seeds": [True]}, r"seeds: found \[True\]"),
            ({"start": {"thta": (0, 1)}}, "start.thta: 'thta' is no component of the state; did you mean 'theta'?"),
            ({"device": "gpu"}, "device: found 'gpu'; did you mean 'cuda'?"),
            ({"solver": "rk4"}, r"solver: found 'rk4'; give one, as expertaug.Solver\(.rk4.\)"),
            ({"forecast_solver": "rk4"}, "forecast_solver: found 'rk4'"),
            ({"horizon_s": "1"}, "training.horizon_s: found '1'"),
            ({"horizon_s": 100.0}, "training.horizon_s: found 100; the data end at "),
            ({"label": 3}, "^label: found 3; give a text"),
            ({"objective": ea.DampedPendulum}, "objective: the class DampedPendulum is no Objective"),
            ({"preset": "best"}, "preset"),
            ({"choices": {"colour": "red"}}, "choices.colour"),
            ({"objective": ea.HybridVAE}, "prior: missing, HybridVAE needs it"),
            ({"objective": lambda *a: None}, "objective: found function .*lambda"),
            ({"prior": {"omega": (0, 1)}}, "prior: gives omega; give .* omega0"),
        ],
    )
    def test_of_fit(self, sets, recipe, options, expected):
        with pytest.raises(ea.InputError, match=expected) as caught:
            ea.fit(recipe, sets["train"], sets["validation"], **({"observed_s": 1.0} | options))
        assert "\n" not in str(caught.value)

    def test_of_sets(self, sets, recipe, fit):
        good = sets["validation"]
        short = ea.Trajectories(good.t[:20], good.y[:, :20], good.z_e)
        other = ea.simulate(ea.RLC(), {"L": (1, 2), "C": (1, 2)}, {"R": (1, 2)}, n=3, t=T)
        for wrong, expected in (
            (short, "validation: has the times"),
            (other, "validation: y has shape"),
            (good.y, "validation: is ndarray; give expertaug.Trajectories"),
        ):
            with pytest.raises(ea.InputError, match=expected):
                ea.fit(recipe, sets["train"], wrong, observed_s=1.0)
        with pytest.raises(ea.InputError, match="model: is DampedPendulum"):
            ea.fit(ea.DampedPendulum(), sets["train"], good, observed_s=1.0)
        with pytest.raises(ea.InputError, match="train: has the times"):
            ea.augment(fit, short, short, prior=SHIFTED)
        with pytest.raises(ea.InputError, match="window"):
            fit.evaluate(ea.Trajectories(good.t * 2, good.y, good.z_e))

    @pytest.mark.parametrize(
        ("options", "expected"),
        [
            ({"prior": {"alpha": (0, 1)}}, "prior: gives alpha; give .* omega0"),
            ({"prior": {"omega0": (3, 1)}}, r"prior.omega0: found \[3, 1\]"),
            ({"prior": {"omega0": 3}}, "prior.omega0: found 3"),
            ({"prior": SHIFTED, "noise": -1.0}, "noise: found -1.0"),
        ],
    )
    def test_of_finetune(self, fit, sets, options, expected):
        with pytest.raises(ea.InputError, match=expected):
            ea.finetune(fit, sets["train"], sets["validation"], **options)

    def test_of_a_control(self, fit, sets):
        samples = ea.augment(fit, sets["train"], sets["validation"], prior=SHIFTED)
        with pytest.raises(ea.InputError, match="given both control and augmented"):
            ea.finetune(fit, sets["train"], sets["validation"], augmented=samples, control=True)

    def test_of_augment(self, fit, sets):
        with pytest.raises(ea.InputError, match=r"worst: found 3.0; give a share from 0 to 1"):
            ea.augment(fit, sets["train"], sets["validation"], prior=SHIFTED, worst=3.0)
