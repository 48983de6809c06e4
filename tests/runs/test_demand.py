"""What a run asks of a cluster, by what published ones took."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from expertaug.config import load
from expertaug.config.models import Configuration, Data, Experiment, Override
from expertaug.errors import InputError
from expertaug.evaluation import costs
from expertaug.learning.settings import TrainSettings
from expertaug.runs import demand
from expertaug.systems.settings import SimulatedSet

ROOT = Path(__file__).parents[2]


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


def test_a_folder_without_published_runs_is_refused(tmp_path):
    with pytest.raises(InputError, match="no published run in"):
        demand.of_config(config([0], 1, 10), tmp_path)


def test_half_a_minute_is_not_printed_as_no_time():
    lines = demand.table([demand.Row("train", 1, 0.0083, 0.0083, 100.4, 1)])
    assert lines[2] == "| train | 1 | 0.01 | 0.01 | 100 | 1 |"


def test_the_same_job_is_taken_as_it_was_from_the_run_that_has_most_of_them(published):
    """A run of more seeds or samples says nothing of jobs that another run has as they are asked for."""
    text = (published / "one" / "config.yaml").read_text()
    others = {"larger": config([0], 1, 10, 900), "more_seeds": config([0, 1, 2], 3, 10)}
    for name, other in {**others, "fewer_jobs": None}.items():
        (published / name).mkdir()
        (published / name / "config.yaml").write_text(yaml.safe_dump(other.dump()) if other else text)
        seeds = "0_1_2" if name == "more_seeds" else "0"
        row = f"train/p_q_a_seeds_{seeds},9000,8000"
        (published / name / "costs.csv").write_text(f"job,seconds,peak_memory_mb\n{row}\n")
    rows = {row.stage: row for row in demand.of_config(config([0], 1, 10), published)}
    assert rows["train"][1:] == pytest.approx((2, 1.01, 1.0, 1000, 2))


def test_the_published_default_asks_for_what_it_took(tmp_path):
    """Also beside runs of more seeds and of other methods."""
    for name in ("default", "five_seeds", "code"):
        (tmp_path / name).symlink_to(ROOT / "results/published" / name)
    told = json.loads((ROOT / "results/published/default/provenance.json").read_text(encoding="utf-8"))
    took = costs.read(ROOT / "results/published/default/costs.csv")
    seconds = sum(cost.alone_s for job, cost in took.items() if job.partition("/")[0] in demand.STAGES)
    asked = load.complete_configuration(load.load([ROOT / "results/published/default/config.yaml"]))
    rows = demand.of_config(asked, tmp_path)
    assert sum(row.hours for row in rows) == pytest.approx(seconds / 3600)
    assert max(row.memory_mb for row in rows) == told["peak_memory_mb"]
    today = load.complete_configuration(load.load(load.with_defaults([ROOT / "config/config.yaml"])))
    assert sum(row.hours for row in demand.of_config(today, tmp_path)) >= 0.999 * seconds / 3600  # nothing is left out


def test_a_job_beside_other_work_asks_for_what_it_takes_alone():
    assert costs.Cost(90.0, 60.0).alone_s == 60 and costs.Cost(90.0).alone_s == 90
    assert costs.Cost(60.0, 61.0).alone_s == 60
