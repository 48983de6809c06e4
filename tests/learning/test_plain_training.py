"""Training parts that are ordinary PyTorch: through the stages, alone or in a group."""

import pytest
import torch

from expertaug.errors import InputError
from expertaug.learning import augment as augmentation
from expertaug.learning.augment import run_stage as augment
from expertaug.learning.finetune import run_stage as finetune
from expertaug.learning.settings import AugmentJob, Build, FinetuneJob
from expertaug.learning.train import run_stage as train
from expertaug.models import store
from expertaug.models.estimators import Hybrid
from expertaug.models.settings import PartsSettings
from nightly import others_slow
from tiny import PRIOR, but, of_kind


def trained(data, folder, settings, seeds):
    output = folder / f"{len(seeds)}_{seeds[0]}.safetensors"
    train(data, output, folder / f"work{seeds}", but(settings, seeds=seeds), None)
    return output


@pytest.mark.parametrize(
    ("encoder", "interaction"),
    others_slow(
        [
            ("KeywordEncoder", "OwnInteraction"),
            ("LinearEncoder", "LinearInteraction"),
            ("GRUEncoder", "SpectralInteraction"),
            ("InheritedEncoder", "LinearInteraction"),
        ]
    ),
)
def test_a_group_trains_as_each_seed_alone_and_is_kept(data, tmp_path, settings, encoder, interaction):
    own = [f"plain_parts:{encoder}", f"plain_parts:{interaction}"]
    parts = PartsSettings(encoder={"kind": own[0]}, interaction={"kind": own[1]})
    settings = but(settings, model=parts, training=but(settings.training, epochs=1))
    together = store.load(trained(data, tmp_path, settings, [0, 1]), classes=own).model.state_dict()
    stored = store.load(tmp_path / "2_0.safetensors", classes=own)
    start = Hybrid.network(stored.model.system, stored.card)
    assert any(not torch.equal(v, together[k]) for k, v in start.state_dict().items())
    for k in range(2):
        alone = store.load(trained(data, tmp_path, settings, [k]), classes=own).model.state_dict()
        for name, value in alone.items():
            torch.testing.assert_close(together[name][k], value[0], rtol=2e-3, atol=2e-4, msg=name)


@pytest.mark.slow
def test_plain_parts_are_augmented_and_finetuned_with_theta_frozen(data, tmp_path, settings):
    own = ["plain_parts:LinearEncoder", "plain_parts:SpectralInteraction"]
    parts = PartsSettings(encoder={"kind": own[0]}, interaction={"kind": own[1]})
    settings = but(settings, model=parts, choices=but(settings.choices, frozen="interaction_and_z_e_head"))
    model = trained(data, tmp_path, settings, [0, 1])
    augment(model, data, tmp_path / "plus.st", of_kind(AugmentJob, settings, prior=PRIOR, noise=0.01, classes=own))
    plus = augmentation.load(tmp_path / "plus.st", torch.device("cpu"), torch.arange(31) * 0.1)
    assert plus.train.y.isfinite().all()
    tuned = of_kind(FinetuneJob, settings, method="a+", label="A+", classes=own)
    finetune(model, tmp_path / "plus.st", data, tmp_path / "plus.safetensors", tmp_path / "w", tuned, None)
    before, after = (store.load(p, classes=own).model.state_dict() for p in (model, tmp_path / "plus.safetensors"))
    for name, value in before.items():
        kept = name.startswith(("decoder.", "encoder.module.head."))
        assert torch.equal(value, after[name]) == kept, name


def test_a_loss_that_is_not_one_number_a_seed_is_refused(data, tmp_path, settings):
    job = but(settings, build=Build(kind="hybrid", objective="plain_parts:ScalarLoss"))
    with pytest.raises(InputError, match=r"ScalarLoss.* shape \(\); .*\(2,\)"):
        train(data, tmp_path / "m", tmp_path / "work", job, None)
