"""Models that are saved and read again, with parts of the package and with parts of one's own."""

from functools import partial

import numpy as np
import pytest
import torch
from small_pendulum import ENCODER, INTERACTION, OPTIONS, SHIFTED, T

import expertaug as ea


class Swing(ea.DampedPendulum):
    """As somebody writes it in a notebook."""

    def __init__(self, gain: float = 1.0) -> None:
        self.gain = gain

    def expert(self, t, y, z_e):
        return super().expert(t, y, self.gain * z_e)


class Doubled(ea.Aphynity):
    def loss(self, model, batch, task):
        loss, parts = super().loss(model, batch, task)
        return 2 * loss, parts


def test_what_is_read_forecasts_what_was_saved(fit, sets, tmp_path):
    window = sets["test"].y[:, :11]
    for model in (fit, fit[1]):
        model.save(tmp_path / "m.safetensors")
        again = ea.load(tmp_path / "m.safetensors")
        assert again.seeds == model.seeds and again.solver == model.solver and len(again.history) == 0
        before = model.forecast(window, T).y
        np.testing.assert_array_equal(again.forecast(window, T).y.reshape(before.shape), before)


def test_a_model_from_a_file_can_be_fine_tuned(fit, plus, sets, tmp_path):
    fit.save(tmp_path / "m.safetensors")
    again = ea.load(tmp_path / "m.safetensors")
    tuned = ea.finetune(again, sets["train"], sets["validation"], prior=SHIFTED, noise=0.01, **OPTIONS)
    found, expected = tuned.stored.model.state_dict(), plus.stored.model.state_dict()
    assert all(torch.equal(found[k], expected[k]) for k in expected) and tuned.label == "Aphynity+"


def test_classes_of_ones_own_train_fine_tune_and_are_read_when_given(sets, tmp_path):
    recipe = ea.HybridModel(Swing(gain=2.0), ENCODER, INTERACTION)
    options = {"observed_s": 1.0, "epochs": 1}
    fit = ea.fit(recipe, sets["train"], sets["validation"], objective=partial(Doubled, lambda0=3.0), **options)
    plus = ea.finetune(fit, sets["train"], sets["validation"], prior=SHIFTED, epochs=1)
    plus.save(tmp_path / "m.safetensors")
    with pytest.raises(ea.InputError, match=r"needs .*:Swing, which is not part of expertaug"):
        ea.load(tmp_path / "m.safetensors")
    again = ea.load(tmp_path / "m.safetensors", classes=[Swing, Doubled])
    assert again.system.gain == 2.0 and again.stored.card.objective.endswith(":Doubled")
    window = sets["test"].y[:, :11]
    np.testing.assert_array_equal(again.forecast(window, T).y, plus.forecast(window, T).y)
    more = ea.finetune(again, sets["train"], sets["validation"], prior=SHIFTED, epochs=1)
    assert more.label == "Doubled++"


def test_what_no_file_can_hold_still_trains(sets, tmp_path):
    class Odd(ea.DampedPendulum):
        def __init__(self, of=None):
            self.of = of

    recipe = ea.HybridModel(Odd(of=object()), ENCODER, INTERACTION)
    fit = ea.fit(recipe, sets["train"], sets["validation"], observed_s=1.0, epochs=1)
    with pytest.raises(ea.InputError, match="cannot describe this"):
        fit.save(tmp_path / "m.safetensors")
    assert not list(tmp_path.iterdir())


def test_the_mean_of_a_workflow_can_be_used(sets, tmp_path):
    from expertaug.learning.settings import UntrainedOptions
    from expertaug.learning.train import make_untrained
    from expertaug.models import store
    from expertaug.models.card import RecipeRecord
    from expertaug.presets import resolve

    names = dict.fromkeys(("experiment", "method", "label"), "mean") | {"preset": "corrected"}
    settings = UntrainedOptions(**names, choices=resolve("corrected"), seeds=[0, 1], t1_s=1.0)
    described = RecipeRecord(system={"name": "pendulum"})
    stored = make_untrained("mean", ea.DampedPendulum(), sets["train"], settings, described)
    store.save(tmp_path / "m.safetensors", stored.model, stored.card)
    again = ea.load(tmp_path / "m.safetensors")
    found = again[1].forecast(sets["test"].y[:, :11], T)
    np.testing.assert_allclose(found.y, np.broadcast_to(sets["train"].y.mean(0), found.y.shape), atol=1e-6)
    assert found.z_e == {} and again.estimate(sets["test"].y[:, :11], T[:11]) == {}
    with pytest.raises(ea.InputError, match="t: has the times"):
        again.forecast(sets["test"].y[:, :11], T * np.linspace(1, 1, 21) + 0.01 * (T > 1.05))
    with pytest.raises(ea.InputError, match="only hybrid models"):
        ea.augment(again, sets["train"], sets["validation"], prior=SHIFTED)
