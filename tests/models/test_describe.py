"""What a hybrid model is made of, and how a file says it."""

from dataclasses import replace
from functools import partial

import pytest
import torch

import plain_parts as parts
from expertaug.errors import InputError
from expertaug.models.describe import describe, is_built_in, recipe_of, system_of
from expertaug.models.encoders.window import WindowEncoder
from expertaug.models.hybrid import HybridModel
from expertaug.models.interactions.mlp import MLPInteraction
from expertaug.systems.reaction_diffusion import ReactionDiffusion
from expertaug.systems.rlc import RLC

SYSTEM = RLC(source_rad_s=3.0)
TIMES = [0.0, 0.1, 0.2]
WINDOWS = {"U": [0.0, 0.2]}


def same(one, other) -> bool:
    return all(torch.equal(a, b) for a, b in zip(one.parameters(), other.parameters(), strict=True))


def test_every_form_of_a_part_makes_the_same_networks():
    by_kind = HybridModel(SYSTEM, {"kind": "window", "windows": WINDOWS, "latent": 1}, {"kind": "mlp"})
    by_class = HybridModel(SYSTEM, partial(WindowEncoder, windows=WINDOWS, latent=1), MLPInteraction)
    by_path = HybridModel(
        SYSTEM,
        {"kind": "expertaug.models.encoders.window:WindowEncoder", "windows": WINDOWS, "latent": 1},
        partial(MLPInteraction),
    )
    nets = [recipe.build(TIMES, [0, 7]) for recipe in (by_kind, by_class, by_path)]
    assert same(nets[0], nets[1]) and same(nets[0], nets[2])
    assert describe(by_class) == describe(by_kind)


def test_a_description_makes_the_same_recipe():
    recipe = HybridModel(SYSTEM, partial(parts.LinearEncoder, width=(4)), partial(parts.LinearInteraction, width=3))
    described = describe(recipe)
    assert described.model_dump() == {
        "system": {"name": "rlc", "source_rad_s": 3.0},
        "model": {
            "encoder": {"kind": "plain_parts:LinearEncoder", "width": 4},
            "interaction": {"kind": "plain_parts:LinearInteraction", "width": 3},
        },
        "expert": True,
        "interaction": True,
        "shared": [],
    }
    shared = replace(recipe, shared=("L",))
    assert recipe_of(SYSTEM, describe(shared)).shared == ("L",)
    again = recipe_of(system_of(described), described)
    assert again.system.source_rad_s == 3.0
    assert same(again.build(TIMES, [0]), recipe.build(TIMES, [0]))


def test_without_interaction_a_description_says_so():
    described = describe(HybridModel(SYSTEM, parts.LinearEncoder, expert=False))
    assert described.interaction is False and described.expert is False
    assert recipe_of(system_of(described), described).build_one(TIMES).decoder.interaction is None


def test_a_class_of_a_function_or_notebook_can_be_built_and_is_described_by_its_name():
    class Local(parts.LinearEncoder): ...

    recipe = HybridModel(SYSTEM, Local)
    assert recipe.build(TIMES, [0]) is not None
    described = describe(recipe)
    kind = described.model.encoder["kind"]
    assert kind.endswith("<locals>.Local")
    again = recipe_of(system_of(described), described, {kind: Local})
    assert same(again.build(TIMES, [0]), recipe.build(TIMES, [0]))


@pytest.mark.parametrize(
    ("encoder", "expected"),
    [
        ({"kind": "window"}, r"model\.encoder: window: missing a required argument: 'windows'"),
        ({"kind": "window", "windows": WINDOWS, "activation": "zzz"}, r"encoder\.activation: found 'zzz'; known: relu"),
        ({"kind": "window", "windows": WINDOWS, "layers": "16"}, r"encoder\.layers: found '16'; give a list"),
        ({"kind": "window", "windows": WINDOWS, "layers": [-1]}, r"layers\[0\]: found -1; give 1 or more"),
        ({"kind": "window", "windows": WINDOWS, "latent": "a"}, r"encoder\.latent: found 'a'; give a whole number"),
        ({"kind": "window", "windows": {"U": [0, 5]}}, r"windows\.U: \[0\.0, 5\.0\] s; the encoder sees 0 to 0\.2 s"),
        ({"kind": "conv"}, r"model\.encoder\.kind: RLC has states of shape \(2,\); choose one for plain states"),
        (partial(parts.LinearEncoder, 3), r"model\.encoder: arguments without a name"),
        (3, r"model\.encoder: found int; give a class"),
        (dict, r"model\.encoder\.kind: the class dict is no Module"),
    ],
)
def test_what_an_encoder_refuses_is_one_line(encoder, expected):
    with pytest.raises(InputError, match=expected):
        HybridModel(SYSTEM, encoder).build(TIMES, [0])


@pytest.mark.parametrize("kind", ["window", "recurrent", "two_step"])
def test_encoders_of_plain_states_refuse_fields(kind):
    fields = ReactionDiffusion()
    options = {"windows": {"u": [0.0, 0.2]}} if kind == "window" else {}
    with pytest.raises(InputError, match=r"ReactionDiffusion has states of shape \(2, 32, 32\); "):
        HybridModel(fields, {"kind": kind} | options).build(TIMES, [0])
    with pytest.raises(InputError, match=r"model\.interaction\.kind: ReactionDiffusion has states of shape"):
        HybridModel(fields, {"kind": "moments"}, {"kind": "mlp"}).build(TIMES, [0])


def test_a_file_of_an_earlier_version_names_a_class_where_it_stood_then():
    moved = {"kind": "expertaug.models.encoders.convolutional:ConvEncoder", "channels": [2], "strides": [1]}
    recipe = HybridModel(ReactionDiffusion(), moved)
    assert is_built_in(moved["kind"])
    assert not is_built_in("mine.encoders.convolutional:ConvEncoder")
    assert recipe.build_one(TIMES).encoder.latent == 10
