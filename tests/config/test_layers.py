"""Layers of a configuration: what overrides what, what is inherited, and what null takes away."""

from __future__ import annotations

import re

import pytest
import yaml

from expertaug.config import layers
from expertaug.config import load as config
from expertaug.config.yaml_file import Located
from expertaug.errors import InputError, InputErrors
from expertaug.learning.settings import TrainSettings
from shipped import refused


def test_a_long_chain_of_experiments_is_one_line(base):
    chain = {f"e{k}": {"based_on": f"e{k + 1}"} for k in range(1500)} | {"e1500": {"based_on": "pendulum"}}
    found = refused(base, yaml.safe_dump({"experiments": chain}))
    assert "based_on: more than 100 experiments, one based on the next" in found


def test_an_experiment_may_differ_under_a_preset(base: dict) -> None:
    presets = {"code": {"data": {"noise": 0.5}}, "paper": {"training": {"epochs": 7}}}
    over = {"experiments": {"pendulum": {"presets": presets}, "x": {"based_on": "pendulum", "data": {"noise": 0.1}}}}
    found = {p: config.validate(config.merge(base, over | {"preset": p})).experiments for p in ("code", "paper")}
    plain = config.validate(base).experiments["pendulum"]
    assert [found[p]["pendulum"].data.noise for p in found] == [0.5, plain.data.noise]
    assert [found[p]["x"].data.noise for p in found] == [0.5, 0.1], "an inherited preset wins as well"
    assert found["paper"]["pendulum"].training.epochs == 7
    assert found["code"]["pendulum"].presets is None
    default = config.validate(config.merge(base, over)).experiments["pendulum"]
    assert default.data == plain.data and default.training == plain.training


def test_keys_of_a_preset_that_is_not_chosen_may_be_those_of_a_kind_that_is_replaced(base: dict) -> None:
    presets = {"code": {"model": {"interaction": {"layers": [8]}}}}
    own = {"kind": "equation", "terms": ["omega: abs(omega) * omega"]}
    over = {"run": ["pendulum"], "experiments": {"pendulum": {"model": {"interaction": own}, "presets": presets}}}
    over["experiments"]["pendulum"] |= {
        "methods": ["aphynity"],
        "augmented": ["aphynity"],
        "controls": [],
        "refined": [],
        "flows": [],
    }
    assert config.validate(config.merge(base, over)).experiments["pendulum"].model.interaction["kind"] == "equation"


def test_choices_win_over_those_of_an_experiments_presets(base: dict) -> None:
    presets = {"corrected": {"choices": {"resample": "epoch", "supervision": "raw"}}}
    over = {"experiments": {"pendulum": {"presets": presets}}}
    by_default = config.validate(config.merge(base, over)).experiments["pendulum"].choices
    assert (by_default.resample, by_default.supervision) == ("epoch", "raw")
    of_code = config.validate(config.merge(base, over | {"preset": "code"})).experiments["pendulum"].choices
    assert of_code.resample == "once"
    over["experiments"]["pendulum"]["choices"] = {"resample": "once"}
    chosen = config.validate(config.merge(base, over)).experiments["pendulum"].choices
    assert (chosen.resample, chosen.supervision) == ("once", "raw")


def test_null_takes_an_inherited_set_away(base: dict) -> None:
    def over(name: str) -> dict:
        return config.merge(base, {"run": ["pendulum"], "experiments": {"pendulum": {"data": {"sets": {name: None}}}}})

    assert "iid" in config.validate(base).experiments["pendulum"].data.set_names
    assert "iid" not in config.validate(over("iid")).experiments["pendulum"].data.set_names
    with pytest.raises(InputError, match=r"pendulum\.data\.sets\.train: missing"):
        config.validate(over("train"))


def test_null_that_takes_nothing_away_is_told(base):
    """A misspelt name would leave what it was to take away, in silence."""
    nulls = {"augmentations": {"narow": None}, "data": {"sets": {"idd": None}}}
    with pytest.raises(InputErrors) as refused:
        config.validate(config.merge(base, {"experiments": {"pendulum": nulls}}))
    told = "\n".join(str(error) for error in refused.value.errors)
    for name, meant in (("augmentations.narow", "narrow"), ("data.sets.idd", "iid")):
        assert re.search(
            rf"pendulum\.{name}: null, where there is nothing of that name; did you mean '{meant}'\?", told
        )
    inherited = {"based_on": "pendulum", "augmentations": {"narrow": None}}
    more = config.merge(base, {"experiments": {"other": inherited}})
    assert "narrow" not in config.validate(more).experiments["other"].augmentations


@pytest.mark.parametrize("twice", [False, True])
def test_null_in_two_layers_takes_away_once(base, twice):
    removed = {"augmentations": {"narrow": None}}
    layers = config.merge(base, {"experiments": {"pendulum": removed}})
    if twice:
        layers = config.merge(layers, {"experiments": {"pendulum": removed}})
    assert "narrow" not in config.validate(layers).experiments["pendulum"].augmentations


def test_mappings_are_merged_key_by_key_unless_they_name_another_kind():
    base = {"encoder": {"kind": "window", "layers": [3], "latent": 1}, "seeds": [0, 1]}
    same = layers.merge(base, {"encoder": {"layers": [4]}, "seeds": [2]})
    assert same == {"encoder": {"kind": "window", "layers": [4], "latent": 1}, "seeds": [2]}
    other = layers.merge(base, {"encoder": {"kind": "recurrent", "hidden": 2}})
    assert other["encoder"] == {"kind": "recurrent", "hidden": 2}
    other["seeds"].append(7)
    assert base["seeds"] == [0, 1], "what was merged is a copy"


def test_settings_are_overridden_block_by_block():
    whole = TrainSettings.of(epochs=3, objective={"a": 1.0, "b": 2.0}, solver={"method": "rk4", "substeps": 2})
    over = TrainSettings.of(objective={"b": 3.0}, solver={"substeps": 4})
    found = layers.overridden(whole, over)
    assert found.epochs == 3 and found.objective == {"a": 1.0, "b": 3.0}
    assert (found.solver.method, found.solver.substeps) == ("rk4", 4)


def test_the_command_line_says_words_and_numbers_as_snakemake_hands_them_on():
    said = {"a": "true", "b": "5", "c": {"d": "1e-3", "e": ["2", "x", "null"], "f": "007"}}
    found = layers.of_command_line(said)
    assert found == {"a": True, "b": "5", "c": {"d": 0.001, "e": [2, "x", None], "f": "007"}}
    assert layers.origin_of(found, ["c", "d"]) == "--config"


def test_where_a_value_was_said_goes_with_it():
    one = Located({"a": Located({"x": 1, "y": 2}, {"x": "one:1", "y": "one:2"})}, {"a": "one:0"})
    two = Located({"a": Located({"y": 3}, {"y": "two:1"})}, {"a": "two:0"})
    merged = layers.merge(layers.mark(one, "by a preset"), two)
    assert layers.origin_of(merged, ["a", "x"]) == "one:1, by a preset"
    assert layers.origin_of(merged, ["a", "y"]) == "two:1" and layers.origin_of(merged, ["b"]) is None


def test_an_experiment_that_is_based_on_itself_takes_those_above_it_along():
    blocks = {"a": {"based_on": "b"}, "b": {"based_on": "a"}, "c": {"based_on": "a"}, "d": {"x": 1}}
    made, errors = layers.inherit({name: Located(block) for name, block in blocks.items()})
    assert list(made) == ["d"] and [error.where for error in errors] == ["experiments.b.based_on"]
