"""The stage finetune: the encoder on D ∪ D⁺."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from expertaug.learning import augmentation
from expertaug.learning.fitting import fit
from expertaug.learning.sets import StackedSet
from expertaug.learning.task import task_of
from expertaug.models import store
from expertaug.models.device import device_of
from expertaug.models.hybrid import HybridNet
from expertaug.trajectories import Trajectories


def finetune(
    model: Path,
    augmented: Path,
    data: Path,
    output: Path,
    work: Path,
    settings: Mapping,
    tracking: Mapping | None,
) -> None:
    """Stage: fine-tune the encoder on D ∪ D⁺ with θ frozen (paper, Algorithm 1); θ is asserted unchanged.

    Arguments:
        settings: {experiment, method, label, preset, training, choices, seeds, device}; method and label name the
            augmented method.
    """
    device = device_of(settings["device"])
    stored = store.load(model, device)
    choices, seeds = settings["choices"], stored.seeds
    plus, plus_validation, header = augmentation.load(augmented, device)
    train_set, validation_set = (
        StackedSet.of(Trajectories.load(Path(data) / f"{name}.npz"), device) for name in ("train", "validation")
    )
    hybrid: HybridNet = stored.model
    prefixes = list(hybrid.decoder_prefixes)
    if choices["frozen"] == "interaction_and_z_e_head":
        prefixes.append(f"encoder.{hybrid.encoder.head_prefix}")
    before = {}
    for name, parameter in hybrid.named_parameters():
        if name.startswith(tuple(prefixes)):
            parameter.requires_grad_(False)
            before[name] = parameter.detach().clone()
    base = dict(stored.description)
    training = {
        **{k: base["training"][k] for k in ("solver", "horizon_s") if k in base["training"]},
        **settings["training"],
    }
    first = base["training"].get("objective", {}) | base["carried"]
    training["objective"] = first | training.get("objective", {})
    scale = augmentation.prior_scale(hybrid, header["prior"]).to(device)
    task = task_of(training, base, device, scale)

    def sets(points: int) -> tuple[object, list]:
        real = train_set.window(points)
        validation = [(validation_set, task.selection(choices)), (plus_validation, range(1, len(plus_validation.y)))]
        if choices["resample"] == "once":
            return real | plus, validation
        source = store.load(model, device).model
        short = task.shortened(points)
        return (
            lambda epoch: (
                real
                | augmentation.generate(
                    source, train_set, short, seeds, header["prior"], header["noise"], 2 + epoch, **header["options"]
                )
            ),
            validation,
        )

    description = base | {k: settings[k] for k in ("experiment", "method", "label", "preset", "choices")}
    fit(
        hybrid,
        sets,
        task,
        description
        | {
            "stage": "finetune",
            "training": training,
            "augmented_prior": header["prior"],
            "base_wall_s": base["wall_s"],
        },
        settings | {"seeds": seeds, "training": training, "prior": header["prior"]},
        (output, work, [Path(model), Path(augmented), Path(data) / "train.npz", Path(data) / "validation.npz"]),
        tracking,
        unchanged=before,
    )
