"""Where paper and code disagree, each preset's choices are what its table says."""

from __future__ import annotations

from pathlib import Path

import pytest

from expertaug import presets, systems
from expertaug.config import load as config
from expertaug.errors import InputError

FOLDER = Path(__file__).parents[1] / "config"


@pytest.mark.parametrize("preset", presets.NAMES)
@pytest.mark.parametrize("one", presets.SIMULATED, ids=lambda one: f"{one.experiment}.{one.key}")
def test_the_table_of_presets_says_what_is_simulated(one, preset):
    complete = config.validate(config.merge(config.load([FOLDER / "config.yaml"]), {"preset": preset}))
    value = complete.experiments[one.experiment].dump()
    *above, last = one.key.split(".")
    for part in above:
        value = value[part]
    found = getattr(systems.load(value), last) if above == ["system"] else value[last]
    assert found == getattr(one, preset)


def test_single_rows_override_a_preset():
    code, mixed = presets.resolve("code"), presets.resolve("code", {"noise": "none"})
    assert {name: getattr(code, name) for name in presets.ROWS} == {n: row.code for n, row in presets.ROWS.items()}
    assert mixed.noise == "none" and mixed.model_copy(update={"noise": code.noise}) == code


@pytest.mark.parametrize("preset", presets.NAMES)
def test_a_preset_chooses_what_its_rows_may_be(preset):
    assert presets.wrong_choice({name: getattr(row, preset) for name, row in presets.ROWS.items()}) is None


@pytest.mark.parametrize(
    ("preset", "choices", "expected"),
    [
        ("papr", {}, "preset: 'papr' is no preset; did you mean 'paper'?"),
        ("paper", {"resampl": "once"}, "choices.resampl: unknown key; did you mean 'resample'?"),
        ("paper", {"resample": "onec"}, "choices.resample: 'onec' is no choice; did you mean 'once'?"),
    ],
)
def test_what_is_no_choice_is_one_line(preset, choices, expected):
    with pytest.raises(InputError) as caught:
        presets.resolve(preset, choices)
    assert str(caught.value).startswith(expected)
