"""Which jobs a configuration means: groups of seeds, versions of methods, cards."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pytest
import yaml

from expertaug.config import jobs, stage_settings
from expertaug.config import load as config
from expertaug.config.models import Configuration
from expertaug.stages import planned

ROOT = Path(__file__).parents[2]


def test_an_experiment_may_have_seeds_of_its_own(base):
    found = config.validate(config.merge(base, {"experiments": {"rlc": {"seeds": [7, 8]}}}))
    assert jobs.seed_groups(found, "rlc") == {"seeds_7_8": [7, 8]}
    assert jobs.seed_groups(found, "pendulum") == jobs.seed_groups(found) == {"seeds_0_1_2": [0, 1, 2]}
    for stage, method in ((stage_settings.train, "aphynity"), (stage_settings.finetune, "aphynity+")):
        assert stage(found, "rlc", method, "seeds_7_8")["seeds"] == [7, 8]


def test_blocks_and_variants(base):
    methods = {"methods": ["mean", "aphynity"], "augmented": ["aphynity"]}
    own = {"experiments": {"x": {"based_on": "pendulum", **methods, "controls": [], "flows": [], "refined": []}}}
    found = config.validate(config.merge(base, own | {"seeds": [4, 0, 7], "seeds_per_job": 2}))
    assert jobs.seed_groups(found) == {"seeds_4_0": [4, 0], "seeds_7": [7]}
    assert jobs.variants(found, "x") == ["mean", "aphynity", "aphynity+"]
    assert jobs.label(found, "aphynity+") == "APHYNITY+"
    # Controls and refined versions that are inherited count for the methods that are there.
    own["experiments"]["x"] |= {"controls": ["aphynity", "hvae"], "refined": ["aphynity+", "hvae", "aphynity="]}
    found = config.validate(config.merge(base, own))
    expected = ["mean", "aphynity", "aphynity=", "aphynity=~refined", "aphynity+", "aphynity+~refined"]
    assert jobs.variants(found, "x") == expected


class TestCards:
    """Jobs that compute on a card ask for it, and a run has one: no two of them are on it at a time."""

    @pytest.mark.parametrize(
        ("device", "driver", "usable", "asked"),
        [("cpu", True, True, 0), ("cuda", False, False, 1), ("auto", False, True, 0), ("auto", True, True, 1)],
    )
    def test_a_job_asks_for_one_where_it_would_take_it(self, monkeypatch, tmp_path, device, driver, usable, asked):
        monkeypatch.setattr(jobs, "DRIVERS", [tmp_path if driver else tmp_path / "none"])
        monkeypatch.setattr("torch.cuda.is_available", lambda: usable)
        assert jobs.cards(Configuration.model_construct(device=device)) == asked

    def test_every_rule_whose_stage_is_told_the_device_asks_for_a_card(self):
        told = {name for name, value in vars(stage_settings).items() if inspect.isfunction(value)}
        told = {name for name in told if '"device"' in inspect.getsource(getattr(stage_settings, name))} | {"flow"}
        text = "".join(path.read_text() for path in sorted((ROOT / "workflow" / "rules").glob("*.smk")))
        asking = {stage.key() for stage in planned.STUDIES.values() if stage.runs_models}
        for rule in re.split(r"^ *rule\b", text, flags=re.M)[1:]:
            if "gpu=GPUS" in rule:
                asking |= set(re.findall(r"stage_params\(\"(\w+)\"", rule.replace("training_of", '"train"')))
        assert asking == told

    def test_a_run_on_one_machine_has_one(self):
        assert "gpu=1" in yaml.safe_load((ROOT / "profiles" / "default" / "config.yaml").read_text())["resources"]
