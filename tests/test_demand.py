"""What a run asks of a cluster, by what published ones took."""

from __future__ import annotations

import pytest
import yaml

from expertaug.config.models import Configuration, Data, Experiment, Override
from expertaug.learning.settings import TrainSettings
from expertaug.runs import demand
from expertaug.systems.settings import SimulatedSet


def config(seeds, per_job, epochs, size=100):
    one = Experiment.model_construct(
        methods=["mean", "a"],
        augmented=["a"],
        refined=["a"],
        data=Data.model_construct(sets={"train": SimulatedSet.of(size=size, z_e={}, z_a={})}),
        training=TrainSettings(epochs=7),
        finetuning=TrainSettings(epochs=2),
        overrides={"a": Override(training=TrainSettings(epochs=epochs))},
    )
    experiments = {"p_q": one, "p": one}
    return Configuration.model_construct(run=["p_q"], seeds=seeds, seeds_per_job=per_job, experiments=experiments)


@pytest.fixture
def published(tmp_path):
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "config.yaml").write_text(yaml.safe_dump(config([0], 1, 10).dump()))
    lines = ["job,seconds,peak_memory_mb", "train/p_q_a_seeds_0,3600,1000", "finetune/p_q_a+_seeds_0,1800,500"]
    lines += ["train/p_q_mean_seeds_0,36,100", "evaluate/p_q_a_seeds_0,360,100"]
    (tmp_path / "one" / "costs.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_hours_go_with_passes_samples_and_seeds_and_memory_with_seeds(published):
    rows = {row.stage: row for row in demand.of_config(config([0, 1, 2, 3], 2, 20, 300), published)}
    assert rows["train"][1:] == pytest.approx((4, 2 * (12 + 0.06), 12, 2000, 4))  # passes 2, samples 3, seeds 2
    assert rows["finetune"][1:] == pytest.approx((2, 2 * 3, 3, 1000, 2))
    # Of four versions one is known, the others take its time: that of twice the seeds.
    assert rows["evaluate"][1:] == pytest.approx((8, 8 * 0.2, 0.2, 200, 2))


def test_a_stage_that_nobody_has_measured_is_not_free(published):
    lines = demand.table(demand.of_config(config([0], 1, 10), published))
    assert "| augment | 1 | ? | ? | ? | 0 |" in lines
    assert lines[-1] == "| all | 8 | 1.9 | 1.0 | 1000 | 4 |"
