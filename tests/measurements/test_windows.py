"""Windows that a trained model observes, from tables: the latest of each trajectory, read as its training read them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from swings import NAMES, STEP, settings, swing, trials

from expertaug.errors import InputError
from expertaug.measurements.stage import cut_measurements
from expertaug.measurements.windows import latest_windows, settings_of

T = STEP * np.arange(40)


def test_the_latest_window_of_each_trajectory_is_its_last_points(tmp_path):
    path = trials(tmp_path, count=2, points=50)
    found = latest_windows([str(path)], settings(path), NAMES, T, observed=10)
    assert found.names == ["swings/0", "swings/1"] and found.left_out == [] and found.u is None
    assert found.start_s == pytest.approx([40 * STEP] * 2) and np.array_equal(found.t, T[:10])
    expected = np.stack([swing(0.3 + 0.2 * k, points=50)[40:] for k in range(2)])
    np.testing.assert_allclose(found.y, expected, atol=1e-6)


def test_a_trajectory_without_such_a_window_is_left_out_or_refused(tmp_path):
    path = trials(tmp_path, count=2, points=50)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:60]) + "\n")  # nine rows of the second
    found = latest_windows([str(path)], settings(path), NAMES, T, observed=10)
    assert found.names == ["swings/0"] and found.left_out == ["swings/1"]
    with pytest.raises(InputError, match=r"no trajectory has a window .* it needs 60 points 0.05 s apart"):
        latest_windows([str(path)], settings(path), NAMES, T, observed=60)


def test_how_a_run_read_its_tables_is_found_beside_its_model_or_in_a_configuration(tmp_path):
    path = trials(tmp_path, count=3, points=80)
    cut_measurements([path], tmp_path / "run" / "data", settings(path), NAMES)
    given = settings(path).of_files([path]).to_json()
    for source in (None, tmp_path / "run" / "data" / "splits.json"):
        assert settings_of(tmp_path / "run" / "models" / "one.safetensors", source).to_json() == given
    assert settings_of(tmp_path / "alone.safetensors", None) is None
    config = tmp_path / "mine.yaml"
    config.write_text(json.dumps({"experiments": {"one": {"data": {"files": given}}, "other": {}}}))
    assert settings_of(tmp_path / "alone.safetensors", config).to_json() == given
    config.write_text(json.dumps({"experiments": {"other": {}}}))
    with pytest.raises(InputError, match="0 experiments have measurements in files"):
        settings_of(tmp_path / "alone.safetensors", config)
