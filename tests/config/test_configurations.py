"""The configurations that come with the project."""

from __future__ import annotations

from pathlib import Path

import pytest

from expertaug.config import jobs, stage_settings
from expertaug.config import load as config
from expertaug.config.load import complete_configuration

FOLDER = Path(__file__).parents[2] / "config"


def settings(name: str) -> dict:
    return config.validate(config.load([FOLDER / "config.yaml", FOLDER / name]))


@pytest.mark.parametrize(
    "experiment",
    ["vgb_pendulum", "vgb_lorenz", "phys_vae_pendulum", "lotka_volterra", "aphynity_wave", "phys_vae_advection"],
)
def test_peers_tasks_that_no_run_names_are_valid_too(experiment: str) -> None:
    loaded = config.load([FOLDER / "config.yaml", FOLDER / "peers.yaml"])
    asked = config.validate(config.merge(loaded, {"run": [experiment]}))
    assert list(asked.run) == [experiment] and "truth" in asked.experiments[experiment].methods


@pytest.mark.parametrize("method", ["expert_only", "ml_only"])
@pytest.mark.parametrize("experiment", ["pendulum", "rlc", "reaction_diffusion", "double_pendulum"])
def test_baselines_train_as_long_as_aphynity_does_in_the_papers_sizes(experiment: str, method: str) -> None:
    paper = settings("paper.yaml")
    group = next(iter(jobs.seed_groups(paper)))
    baseline, aphynity = (
        stage_settings.train(paper, experiment, name, group)["training"] for name in (method, "aphynity")
    )
    keys = ("epochs", "learning_rate", "schedule", "horizon_warmup")
    assert {key: baseline[key] for key in keys} == {key: aphynity[key] for key in keys}


@pytest.mark.parametrize(
    ("experiment", "method", "training", "finetuning"),
    [
        ("pendulum", "aphynity", 50, 50),
        ("pendulum", "hvae", 1000, 100),
        ("rlc", "aphynity", 50, 50),
        ("rlc", "hvae", 1000, 100),
        ("reaction_diffusion", "aphynity", 500, 100),
        ("reaction_diffusion", "hvae", 1000, 100),
        ("double_pendulum", "aphynity", 100, 100),
        ("double_pendulum", "hvae", 100, 100),
    ],
)
def test_nothing_of_the_default_sizes_is_left_in_the_papers(
    experiment: str, method: str, training: int, finetuning: int
) -> None:
    """What overrides a method in config.yaml is stronger than what paper.yaml says of all methods."""
    paper = settings("paper.yaml")
    group = next(iter(jobs.seed_groups(paper)))
    trained = stage_settings.train(paper, experiment, method, group)["training"]
    tuned = stage_settings.finetune(paper, experiment, f"{method}+", group)["training"]
    assert (trained["epochs"], tuned["epochs"]) == (training, finetuning)
    for stage in (trained, tuned):
        assert stage["learning_rate"] == 5e-4
        assert stage["schedule"] == "constant"
        assert stage["supervision_weight"] == 1.0
        assert stage["horizon_warmup"] == stage["expert_first"] == 0.0
    interaction = stage_settings.train(paper, experiment, method, group)["model"]["interaction"]
    assert (interaction.get("start", 1.0), interaction.get("components")) == (1.0, None)


@pytest.mark.parametrize("preset", ["corrected", "paper", "code"])
def test_alternation_on_the_circuit_steps_as_its_other_trainings_do(preset):
    """Sources and rates of the presets differ, and with them the steps that are stable."""
    one = complete_configuration(config.load([FOLDER / "config.yaml"]) | {"preset": preset}).experiments["rlc"]
    alternating = one.overrides["alternating"].alternation.solver.dump()
    assert one.training.solver.dump(include=alternating) == alternating
