"""A partial differential equation in one dimension, with the package's own encoders and interaction models."""

import numpy as np
import pandas as pd
import pytest
import torch

import tiny
from cards import card
from expertaug.evaluation.evaluate import run_stage as evaluate
from expertaug.evaluation.log_evaluations import run_stage as log_evaluations
from expertaug.evaluation.settings import EvaluateJob, Scoring
from expertaug.learning.augment import run_stage as augment
from expertaug.learning.finetune import run_stage as finetune
from expertaug.learning.settings import AugmentJob, Build, FinetuneJob, SolverOnly, UntrainedJob
from expertaug.learning.train import run_stage as train
from expertaug.models import store
from expertaug.models.describe import describe
from expertaug.models.fit_settings import Refinement, RefinementSettings
from expertaug.models.hybrid import HybridModel
from expertaug.models.settings import PartsSettings
from expertaug.systems.settings import SimulatedData, SimulatedSet, UserSystemSettings
from expertaug.systems.solvers.solver import Solver
from expertaug.tracking.log import read_log
from field_systems import Fisher
from nightly import others_slow
from seen import seen
from tiny import but, of_kind

SYSTEM = {"name": "field_systems:Fisher"}


def drawn(rate, **sizes):
    """What is simulated of Fisher's equation, where something reacts at these rates."""
    sets = {name: SimulatedSet(size=n, z_e={"D": (1e-3, 4e-3)}, z_a={"r": rate}) for name, n in sizes.items()}
    return SimulatedData(seed=0, step_s=0.1, t2_s=1.0, noise=0.0, sets=sets)


PARTS = [
    ({"kind": "moments", "layers": [16]}, {"kind": "polynomial", "latent_degree": 1}),
    (
        {"kind": "conv", "channels": [6, 6], "strides": [1, 2], "layers": [16], "latent": 2},
        {"kind": "conv", "channels": [8, 8]},
    ),
]


@pytest.fixture(scope="module")
def fields(tmp_path_factory):
    data = drawn((0.5, 1.5), train=40, validation=10, test=10)
    return tiny.simulated(tmp_path_factory.mktemp("fisher"), data, UserSystemSettings(**SYSTEM))


@pytest.mark.parametrize(("encoder", "interaction"), others_slow(PARTS), ids=["moments", "conv"])
def test_it_is_trained_augmented_and_evaluated(fields, tmp_path, settings, encoder, interaction):
    parts = PartsSettings(encoder=encoder, interaction=interaction)
    how = but(settings.training, epochs=8, learning_rate=1e-2, objective={"lambda0": 1000.0})
    settings = but(settings, experiment="fisher", system=SYSTEM, model=parts, t1_s=0.5, training=how)
    model, plus, tuned = (tmp_path / f"{name}.safetensors" for name in ("model", "plus", "tuned"))
    train(fields, model, tmp_path / "work", settings, None)
    losses = [np.mean(line.metrics["data"]) for line in read_log(tmp_path / "log.jsonl").steps]
    assert losses[-1] < 0.5 * losses[0], losses
    prior, own = {"D": (1e-3, 6e-3)}, [SYSTEM["name"]]
    augment(model, fields, plus, of_kind(AugmentJob, settings, prior=prior, noise=0.0, classes=own))
    settings = but(settings, method="a+", label="A+", training=but(how, epochs=1))
    finetune(model, plus, fields, tuned, tmp_path / "work+", of_kind(FinetuneJob, settings, classes=own), None)
    job = of_kind(EvaluateJob, settings, evaluation=Scoring(samples=2), classes=own)
    evaluate(tuned, fields, tmp_path / "metrics.csv", tmp_path / "forecasts.npz", job)
    table = pd.read_csv(tmp_path / "metrics.csv")
    assert np.isfinite(table["value"]).all() and "relative_error_D" in set(table["metric"])


@pytest.mark.parametrize(
    "parts",
    [*PARTS, (*PARTS[1][:1], {"kind": "damping"}), ({"kind": "conv_two_step", "filter_channels": [4, 4]}, None)],
    ids=["moments", "conv", "damping", "two_step"],
)
def test_shifted_fields_have_the_same_parameters_and_shifted_forecasts(parts):
    t = torch.arange(6) * 0.1
    model = HybridModel(Fisher(), *parts).build(t[:4], [0, 1])
    y = torch.rand(4, 2, 3, 1, 64, generator=torch.Generator().manual_seed(0))
    model.fit(seen(y[:, 0]))
    states, z_e = model.predict(seen(y, t), Solver("rk4"))
    shifted, same = model.predict(seen(y.roll(8, -1), t), Solver("rk4"))
    torch.testing.assert_close(same, z_e, rtol=1e-4, atol=1e-7)
    torch.testing.assert_close(shifted, states.roll(8, -1), rtol=1e-4, atol=1e-5)
    alone = HybridModel(Fisher(), *parts).build(t[:4], [1])
    alone.fit(seen(y[:, 0]))
    torch.testing.assert_close(
        alone.predict(seen(y[:, 1:], t), Solver("rk4"))[0][:, 0], states[:, 1], rtol=1e-4, atol=1e-5
    )


def test_three_dimensions_pass_the_convolutions():
    class Cube(Fisher):
        @property
        def state_shape(self):
            return (1, 4, 4, 4)

    t = torch.arange(3) * 0.1
    for encoder, interaction in PARTS:
        model = HybridModel(Cube(), encoder, interaction).build(t, [0, 1])
        y = torch.rand(3, 2, 2, 1, 4, 4, 4)
        posterior = model.encode(seen(y))
        assert posterior.z_e.mean.shape == (2, 2, 1)
        assert model.interaction_squares(y, *posterior.mean).shape == (2, 6)


def test_a_model_file_of_fields_is_read_again(tmp_path):
    t = [0.0, 0.1, 0.2]
    recipe = HybridModel(Fisher(), *PARTS[1])
    description = describe(recipe).model_dump() | {"kind": "hybrid", "t": t, "observed": 3, "seeds": [4]}
    model = recipe.build(t, [4])
    store.save(tmp_path / "m", model, card(description))
    again = store.load(tmp_path / "m", classes=["field_systems:Fisher"]).model
    y = torch.rand(3, 1, 2, 1, 64)
    assert torch.equal(again.encode(seen(y)).z_e.mean, model.encode(seen(y)).z_e.mean)


def test_least_squares_on_fields_is_evaluated_and_drawn(fields, tmp_path, settings):
    """The expert is the diffusion alone; where nothing reacts it is the truth."""
    data = drawn((0.0, 0.0), train=4, validation=2, test=2)
    tiny.simulated(tmp_path, data, UserSystemSettings(**SYSTEM))
    fitted = of_kind(
        UntrainedJob,
        settings,
        experiment="fisher",
        method="ls",
        label="LS",
        system=SYSTEM,
        build=Build(kind="least_squares"),
        model=PartsSettings(),
        training=SolverOnly(),
        t1_s=0.5,
        refinement=Refinement(settings=RefinementSettings(starts=4, tries=1), noise=0.0, prior={"D": (5e-4, 6e-3)}),
    )
    train(tmp_path, tmp_path / "model", tmp_path / "work", fitted, None)
    job = of_kind(EvaluateJob, fitted, evaluation=Scoring(samples=2), classes=[SYSTEM["name"]])
    evaluate(tmp_path / "model", tmp_path, tmp_path / "metrics.csv", tmp_path / "forecasts.npz", job)
    log_evaluations([tmp_path / "forecasts.npz"], tmp_path / "evaluations.json", None)
    table = pd.read_csv(tmp_path / "metrics.csv").set_index(["set", "metric"])["value"]
    assert table["test", "relative_error_D"].max() < 1.0  # per cent
    assert (tmp_path / "forecasts.png").stat().st_size > 10_000 and (tmp_path / "parameters.png").exists()
