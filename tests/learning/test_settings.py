"""Settings of trainings: schedules against closed forms, and what is refused in one line."""

from __future__ import annotations

import pytest

from expertaug.errors import InputError
from expertaug.learning.settings import FinetuneOptions, TrainSettings
from expertaug.presets import resolve


def test_one_cycle_warms_up_and_decays():
    settings = TrainSettings(learning_rate=1.0, warmup=0.1)
    rates = [settings.rate(k, 100) for k in range(100)]
    assert max(rates) == rates[9] == 1.0 and rates[0] == 0.1 and rates[-1] < 1e-3
    assert TrainSettings(learning_rate=1.0, schedule="constant").rate(50, 100) == 1.0


def test_the_loss_window_grows_over_the_first_share_of_steps():
    settings = TrainSettings(horizon_warmup=0.5)
    points = [settings.points(51, k, 100) for k in range(100)]
    assert points == sorted(points) and points[0] == 2 and points[24] == 26 and set(points[49:]) == {51}
    assert {TrainSettings().points(51, k, 100) for k in range(100)} == {51}
    assert max(TrainSettings(horizon_warmup=0.45).points(51, k, 7) for k in range(7)) == 51


def test_unknown_training_key_is_named():
    with pytest.raises(InputError, match=r"training\.epoch.*unknown"):
        TrainSettings.from_mapping({"epoch": 3})


def test_a_fine_tuning_begins_nothing_anew():
    said = {"experiment": "x", "method": "m", "label": "M", "preset": "corrected", "seeds": [0]}
    with pytest.raises(InputError, match="restarts"):
        FinetuneOptions.of(**said, choices=resolve("corrected"), training={"restarts": 1})
