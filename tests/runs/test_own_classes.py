"""Classes that a configuration names are tried on a few samples before hours of jobs find out what is wrong."""

from __future__ import annotations

import sys

import pytest

from expertaug.config.models import Configuration
from expertaug.errors import InputErrors, lines
from expertaug.runs.own_classes import check_classes
from shipped import default, valid

SYSTEM = """
import torch
from expertaug.systems import Parameter, System


class Spring(System):
    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("k", "1/s^2"),)
    interaction_parameters = (Parameter("c", "1/s"),)

    def expert(self, t, y, z_e):
        return torch.cat((y[..., 1:], -z_e * y[..., :1]), -1)

    def truth(self, t, y, z_e, z_a):
        return self.expert(t, y, z_e) - torch.cat((torch.zeros_like(z_a), z_a * y[..., 1:]), -1)

    def sample_initial_state(self, n, generator):
        return 1 + torch.rand(n, 2, generator=generator, dtype=torch.float64)
"""
EXPERIMENT = """
run: [spring]
device: cpu
experiments:
  spring:
    system: {name: "own_spring:Spring"}
    data:
      source: simulation
      step_s: 0.1
      t1_s: 0.5
      t2_s: 1.0
      sets: {train: &set {size: 2, z_e: {k: [1, 3]}, z_a: {c: [0, 0.5]}}, validation: *set, test: *set}
    model: {encoder: {kind: recurrent, hidden: 4, layers: [4]}, interaction: {kind: mlp, layers: [4]}}
    training: {epochs: 1}
    methods: [mean]
"""


@pytest.fixture
def configured(tmp_path, monkeypatch):
    """A configuration of a system whose source is changed."""

    def make(old: str = "", new: str = "") -> Configuration:
        (tmp_path / "own_spring.py").write_text(SYSTEM.replace(old, new) if old else SYSTEM)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "own_spring", raising=False)
        return valid(default(), EXPERIMENT)

    return make


def test_what_keeps_its_contract_is_a_line_each(configured):
    assert check_classes(configured()) == ["spring: system Spring checked", "spring: method mean checked"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("return 1 + torch.rand(n, 2,", "return 1 / 0 + torch.rand(n, 2,", "ZeroDivisionError"),
        ("torch.cat((y[..., 1:], -z_e * y[..., :1]), -1)", "y[..., :1]", "shape"),
    ],
)
def test_a_class_that_fails_is_one_line_with_its_file(configured, old, new, expected):
    with pytest.raises(InputErrors) as caught:
        check_classes(configured(old, new))
    (line,) = lines(caught.value)
    assert line.startswith("experiments.spring, system (") and "own_spring.py" in line and expected in line


def test_what_is_the_packages_own_may_be_left_out():
    assert check_classes(valid(default(), "{run: [pendulum], device: cpu}"), only_own=True) == []
