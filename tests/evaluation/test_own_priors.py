"""The table of the ranges that p⁺ has found."""

from __future__ import annotations

from expertaug.evaluation.own_priors import OwnPrior, own_priors
from expertaug.evaluation.settings import OwnPriorsJob


def test_the_table_of_ranges():
    row = OwnPrior("A+", "all", "omega0", 1.5, 3.1, 0.5, 3.5, 0.9, 3, True, "it explains 90 %")
    text = own_priors([row], OwnPriorsJob(experiment="e", priors=[("A+", "all")])).markdown()
    assert "| A+ | all | omega0 | [1.5, 3.1] | [0.5, 3.5] | 90 |" in text
