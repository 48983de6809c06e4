"""Fine-tuning on augmented samples: what it changes, what holds its encoder, and its control."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest
import torch

import expertaug as ea
from augmented_pendulum import CPU, PLUS, TIMES, augmented
from expertaug.errors import InputError
from expertaug.learning import augment as augmentation
from expertaug.learning import finetune as tuning
from expertaug.learning.finetune import run_stage as finetune
from expertaug.learning.settings import FinetuneJob
from expertaug.models import store
from nightly import others_slow
from seen import seen
from tiny import PRIOR, but, of_kind


@pytest.mark.slow
def test_supervision_of_z_a_holds_the_encoder_to_it(trained, data, tmp_path, settings):
    """Errors of z_a on augmented samples fall with its weight, and the default of 0 is what files of before have."""
    augmented(trained, data, tmp_path, settings)
    plus, errors = augmentation.load(tmp_path / "plus.st", CPU, TIMES).train, {}
    for weight in (0.0, 100.0):
        training = but(settings.training, epochs=20, z_a_supervision_weight=weight)
        tuned = of_kind(FinetuneJob, settings, **PLUS, training=training)
        finetune(trained, tmp_path / "plus.st", data, tmp_path / "p.st", tmp_path / "work", tuned, None)
        z_a = store.load(tmp_path / "p.st").model.encode(seen(plus.y[:11])).mean[1]
        errors[weight] = (z_a - plus.z_a).square().mean().sqrt().item()
    assert errors[100.0] < 0.8 * errors[0.0]
    tensors = augmentation.read_tensors(tmp_path / "plus.st")
    kept = {name: value for name, value in tensors[1].items() if not name.endswith("z_a")}
    augmentation.write_tensors(tmp_path / "plus.st", kept, tensors[0])
    with pytest.raises(InputError, match="do not say with which z_a they were made; draw them again"):
        finetune(trained, tmp_path / "plus.st", data, tmp_path / "p.st", tmp_path / "work", tuned, None)


@pytest.mark.parametrize("choice", ["weighted", "off"])
def test_z_a_is_supervised_where_the_choice_says_so(trained, data, tmp_path, settings, choice):
    augmented(trained, data, tmp_path, settings)
    training = but(settings.training, epochs=1)
    tuned = {}
    for weight in (0.0, 100.0):
        chosen = but(settings.choices, z_a_supervision=choice)
        job = of_kind(
            FinetuneJob, settings, **PLUS, training=but(training, z_a_supervision_weight=weight), choices=chosen
        )
        finetune(trained, tmp_path / "plus.st", data, tmp_path / "p.st", tmp_path / "work", job, None)
        tuned[weight] = store.load(tmp_path / "p.st")
    encoders = [model.model.encoder.state_dict() for model in tuned.values()]
    same = all(torch.equal(value, encoders[1][name]) for name, value in encoders[0].items())
    assert same == (choice == "off")
    assert tuned[100.0].card.training.z_a_supervision_weight == (100.0 if choice == "weighted" else 0.0)


@pytest.mark.parametrize(
    ("over", "says"),
    [
        ({"prior": {"omga0": [0.5, 3.5]}}, "prior.omga0: 'omga0' is no expert parameter; did you mean 'omega0'?"),
        ({"training": {"objective": {"lambd0": 1.0}}}, "training.objective.lambd0: 'lambd0' is no option of Aphynity"),
    ],
)
def test_a_fine_tuning_refuses_names_that_it_does_not_know(trained, data, tmp_path, settings, over, says):
    augmented(trained, data, tmp_path, settings)
    with pytest.raises(InputError, match=re.escape(says)):
        job = of_kind(FinetuneJob, settings, **over)
        finetune(trained, tmp_path / "plus.st", data, tmp_path / "p.st", tmp_path / "work", job, None)
    assert not (tmp_path / "p.st").exists()


def test_the_interaction_sees_z_a_softly_bounded(trained, data, tmp_path, settings):
    """Where the training windows' lie it is as it was; far outside a tenth of their range; the file holds the bound."""
    augmented(trained, data, tmp_path, settings)
    job = of_kind(FinetuneJob, settings, **PLUS, training=but(settings.training, epochs=1, bound_z_a=True))
    finetune(trained, tmp_path / "plus.st", data, tmp_path / "p.st", tmp_path / "work", job, None)
    base, tuned = store.load(trained), store.load(tmp_path / "p.st")
    bound, support = tuned.model.decoder.latent_bound, base.card.support
    least, most = (torch.tensor(ends).unsqueeze(1) for ends in (support.least_z_a, support.most_z_a))
    torch.testing.assert_close((bound.least, bound.most), (least, most))
    middle, far = (least + most) / 2, most + 100
    torch.testing.assert_close(bound(middle), middle)
    torch.testing.assert_close(bound(far), most + 0.1 * (most - least))
    y, z_e = torch.full((len(tuned.seeds), 1, 2), 0.5), torch.ones(len(tuned.seeds), 1, 1)
    seen_far = tuned.model.decoder.interaction_squares(y[None], z_e, far)
    torch.testing.assert_close(seen_far, base.model.decoder.interaction_squares(y[None], z_e, bound(far)))
    assert not torch.allclose(base.model.decoder.interaction_squares(y[None], z_e, far), seen_far)
    one = ea.load(tmp_path / "p.st")[0]
    assert one.stored.model.decoder.latent_bound.least.shape == (1, 1, least.shape[-1])
    unsaid = replace(base, card=base.card.but(support=None))
    with pytest.raises(InputError, match="does not say where its z_a lie"):
        tuning._bound(unsaid.card, CPU)


@pytest.mark.parametrize("choices", others_slow([{}, {"frozen": "interaction_and_z_e_head"}, {"resample": "epoch"}]))
def test_finetuning_changes_the_encoder_and_nothing_else(trained, data, tmp_path, settings, choices):
    settings = but(settings, choices=but(settings.choices, **choices))
    augmented(trained, data, tmp_path, settings)
    job = of_kind(FinetuneJob, settings, **PLUS)
    finetune(trained, tmp_path / "plus.st", data, tmp_path / "plus.safetensors", tmp_path / "work", job, None)
    before, after = store.load(trained), store.load(tmp_path / "plus.safetensors")
    assert after.card.label == "APHYNITY+" and after.card.best_epoch != [0, 0]
    head_frozen = "frozen" in choices
    for name, value in before.model.state_dict().items():
        frozen = name.startswith("decoder.") or (head_frozen and name.startswith("encoder.head."))
        assert torch.equal(value, after.model.state_dict()[name]) == frozen, name


def test_the_control_takes_the_same_steps_on_real_data_alone(trained, data, tmp_path, settings):
    augmented(trained, data, tmp_path, settings)
    settings = but(settings, training=but(settings.training, epochs=1))
    plus = of_kind(FinetuneJob, settings, **PLUS)
    finetune(trained, tmp_path / "plus.st", data, tmp_path / "plus/m.st", tmp_path / "a", plus, None)
    control = of_kind(FinetuneJob, settings, method="aphynity=", label="APHYNITY (control)")
    with pytest.raises(InputError, match="--augmented: missing; give the augmented samples, or prior"):
        finetune(trained, None, data, tmp_path / "control/m.st", tmp_path / "b", control, None)
    finetune(trained, None, data, tmp_path / "control/m.st", tmp_path / "b", but(control, prior=PRIOR), None)
    steps = {}
    for name in ("plus", "control"):
        lines = map(json.loads, (tmp_path / name / "log.jsonl").read_text().splitlines())
        steps[name] = max(line["step"] for line in lines if "step" in line)
    assert steps["plus"] == steps["control"] > 0
    before, after = store.load(trained), store.load(tmp_path / "control/m.st")
    assert after.card.method == "aphynity=" and after.card.to_json()["augmented_prior"] == PRIOR
    for name, value in before.model.state_dict().items():
        assert torch.equal(value, after.model.state_dict()[name]) == name.startswith("decoder."), name
