"""Algorithm 1: D⁺, whose samples are the model's own; and the rows of the preset table."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from augmented_pendulum import CPU, TIMES, augmented
from expertaug.errors import InputError
from expertaug.learning import augment as augmentation
from expertaug.learning import finetune as tuning
from expertaug.learning.augment import run_stage as augment
from expertaug.learning.expert_share import decorrelate
from expertaug.learning.finetune import run_stage as finetune
from expertaug.learning.objectives import Aphynity
from expertaug.learning.settings import (
    AugmentJob,
    Build,
    FinetuneJob,
    FinetuneOptions,
    SolverOnly,
    TrainSettings,
    UntrainedJob,
)
from expertaug.learning.train import run_stage as train
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models import store
from expertaug.presets import ROWS, Choices, resolve
from expertaug.systems.double_pendulum import DoublePendulum
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import Trajectories
from nightly import others_slow
from seen import seen
from tiny import PRIOR, but, of_kind

Unbounded = SimpleNamespace(bound=None)  # all of a task that this needs


def test_augmented_samples_are_the_models_own(trained, data, tmp_path, settings):
    plus, validation, header = augmented(trained, data, tmp_path, settings, augmentation_noise="none")
    real = StackedSet.of(Trajectories.load(data / "train.npz"), CPU)
    stored = store.load(trained)
    assert header["prior"] == PRIOR and len(plus) == len(real) == 40 and len(validation) == 10
    assert torch.equal(plus.y[0], real.y[0].expand(2, -1, -1)), "x comes from the data"
    assert plus.z_e.min() >= 0.5 and plus.z_e.max() <= 3.5 and plus.z_e.max() - plus.z_e.min() > 2.5
    assert not torch.equal(plus.z_e[0], plus.z_e[1]), "every seed draws its own"
    _, z_a = stored.model.encode(seen(real.y[:11].expand(-1, 2, -1, -1))).mean
    t = torch.tensor(stored.card.t[:11])
    expected = stored.model.forecast(real.y[0].expand(2, -1, -1), plus.z_e, z_a, t, Solver("rk4"))
    torch.testing.assert_close(plus.y, expected.detach())


def test_the_augmented_samples_that_select_go_as_far_as_the_choice_says(trained, data, tmp_path, settings):
    short = None
    stored, sets = store.load(trained), [Trajectories.load(data / f"{name}.npz") for name in ("train", "validation")]
    for choice, times in (("observed", 11), ("forecast", 21)):
        plus, validation, _ = augmented(trained, data, tmp_path / choice, settings, augmented_selection=choice)
        assert len(plus.y) == 11 and len(validation.y) == times
        short = validation if choice == "observed" else short
        samples = augmentation.load(tmp_path / choice / "plus.st", CPU, TIMES)
        said = {"method": "aphynity+", "label": "APHYNITY+", "preset": "corrected", "experiment": "pendulum"}
        chosen = but(settings.choices, augmented_selection=choice)
        options = FinetuneOptions(**said, choices=chosen, seeds=[0, 1], training=settings.training)
        checks = tuning.prepare(stored, samples, *sets, options).trainer.validation
        assert [points for _, points in checks] == [range(1, 11), range(11 if times == 21 else 1, times)]
    assert torch.equal(short.z_e, validation.z_e) and torch.equal(short.z_a, validation.z_a), "the same samples"


def test_augmented_samples_keep_the_z_a_that_made_them(trained, data, tmp_path, settings):
    plus, validation, _ = augmented(trained, data, tmp_path, settings, augmentation_noise="none")
    stored, y = store.load(trained), StackedSet.of(Trajectories.load(data / "train.npz"), CPU).y
    assert torch.equal(plus.z_a, stored.model.encode(seen(y[:11].expand(-1, 2, -1, -1))).mean[1])
    assert validation.z_a.shape == (2, 10, plus.z_a.shape[-1])
    both = StackedSet.of(Trajectories.load(data / "train.npz"), CPU) | plus
    assert torch.isnan(both.z_a[:, :40]).all() and torch.equal(both.z_a[:, 40:], plus.z_a)
    for batch in both.batches([0, 1], 0, 20):
        assert torch.equal(torch.isnan(batch.z_a).any(-1), batch.supervised == 0), "z_a goes with its sample"


def test_a_replaced_sample_is_replaced_whole():
    y, z_e, z_a = torch.rand(5, 1, 4, 2), torch.rand(1, 4, 1), torch.rand(1, 4, 3)
    good, before = torch.tensor([[True, False, True, True]]), z_a.clone()
    y_new, z_e_new, z_a_new, _ = augmentation._replace_diverged(y.clone(), z_e.clone(), z_a, None, good, Unbounded)
    assert torch.equal(z_a, before), "an encoder's own output stays as it is"
    for old, new in ((y.movedim(2, 0), y_new.movedim(2, 0)), (z_e[0], z_e_new[0]), (z_a[0], z_a_new[0])):
        assert torch.equal(new[1], old[2]) and torch.equal(new[[0, 2, 3]], old[[0, 2, 3]])


def test_augmented_samples_get_the_datas_noise(trained, data, tmp_path, settings):
    clean, _, _ = augmented(trained, data, tmp_path, settings, augmentation_noise="none")
    noisy, _, _ = augmented(trained, data, tmp_path, settings)
    assert torch.equal(clean.z_e, noisy.z_e)
    assert (noisy.y - clean.y).std() == pytest.approx(0.01, rel=0.1)


def test_x_of_augmented_samples_is_the_datas_unless_resampled():
    system = DoublePendulum(expert="point_mass")
    y0 = torch.zeros(2, 5000, 4)
    fresh = system.resample_known(y0, lambda k: torch.rand(2, 5000, k))
    assert torch.equal(fresh[..., 2:], y0[..., 2:])
    assert fresh[..., :2].min() < -3.1 and fresh[..., :2].max() > 3.1
    one = DampedPendulum()
    assert one.resample_known(y0, lambda k: None) is y0


@pytest.mark.parametrize("preset", others_slow(["paper", "code"]))
def test_every_preset_trains_augments_and_finetunes(preset, data, tmp_path, settings):
    once = but(settings.training, epochs=1)
    settings = but(settings, choices=resolve(preset), preset=preset, training=once)
    train(data, tmp_path / "m.st", tmp_path / "work", settings, None)
    augmented(tmp_path / "m.st", data, tmp_path, settings)
    job = of_kind(FinetuneJob, settings)
    finetune(tmp_path / "m.st", tmp_path / "plus.st", data, tmp_path / "p.st", tmp_path / "work", job, None)
    assert store.load(tmp_path / "p.st").card.preset == preset


def test_the_mean_cannot_be_augmented(data, tmp_path, settings):
    mean = of_kind(UntrainedJob, settings, build=Build(kind="mean"), training=SolverOnly())
    train(data, tmp_path / "m.st", tmp_path / "w", mean, None)
    with pytest.raises(InputError, match="only hybrid models"):
        augmented(tmp_path / "m.st", data, tmp_path, settings)


def test_prior_must_name_the_parameters(trained, data, tmp_path, settings):
    job = of_kind(AugmentJob, settings, prior={"omega": (0.0, 1.0)}, noise=0.0)
    with pytest.raises(InputError, match=r"augmentation\.prior.*omega0"):
        augment(trained, data, tmp_path / "p.st", job)


class TestPresetRows:
    """Each row of the table changes what it says it changes."""

    @pytest.fixture
    def loss(self, trained, data):
        stored = store.load(trained)
        batch = StackedSet.of(Trajectories.load(data / "train.npz"), CPU).whole(2)

        def compute(model=None, supervised=0.0, lambda0=10.0, batch=batch, points=None, task_keys=None, **choices):
            objective = Aphynity([0, 1], resolve("corrected", choices), lambda0=lambda0)
            task = task_of(TrainSettings(), stored.card, CPU, torch.tensor([0.5]))
            task = replace(task, horizon=objective.window(task), **(task_keys or {}))
            batch = replace(batch, supervised=torch.full_like(batch.supervised, supervised))
            objective.begin(model or stored.model, batch, task)
            task = replace(task, horizon=points or task.horizon)
            return objective, *objective.loss(model or stored.model, batch, task)

        compute.batch, compute.model = batch, stored.model
        return compute

    def test_presets_differ_where_the_table_says(self):
        assert resolve("code").loss_window == "half_batch" and resolve("paper").noise == "none"
        assert resolve("corrected", {"selection": "forecast"}).selection == "forecast"
        assert all(getattr(row, p) in row.values for row in ROWS.values() for p in ("paper", "code", "corrected"))
        for bad, match in (({"colour": 1}, "choices.colour"), ({"penalty": "l1"}, "choices.penalty.*'l1'")):
            with pytest.raises(InputError, match=match):
                resolve("corrected", bad)
        with pytest.raises(InputError, match="preset"):
            resolve("best")

    def test_loss_window(self, loss):
        batch = loss.batch
        later, second = batch.y.clone(), batch.y.clone()
        later[11:] += 1.0
        second[:, :, 20:] += 1.0
        for choice, sees_later in (("observed", False), ("half_batch", True)):
            base = loss(loss_window=choice)[1]
            changed = loss(loss_window=choice, batch=replace(batch, trajectories=seen(later)))[1]
            assert torch.equal(base, changed) != sees_later
        unseen = loss(loss_window="half_batch", batch=replace(batch, trajectories=seen(second)))[1]
        assert torch.equal(unseen, loss(loss_window="half_batch")[1]), "half of the batch is not trained on"
        changed = loss(loss_window="half_batch", points=6, batch=replace(batch, trajectories=seen(later)))[1]
        assert torch.equal(changed, loss(loss_window="half_batch", points=6)[1]), "a window that has not grown yet"

    def test_multiplier(self, loss):
        for choice, grows in (("lagrangian", True), ("fixed", False)):
            objective, _, parts = loss(multiplier=choice)
            objective.end_of_pass()
            expected = 10 + (5 * parts["data"] if grows else 0 * parts["data"])
            torch.testing.assert_close(objective.multiplier, expected)

    def test_penalty(self, loss):
        model, batch = loss.model, loss.batch
        z_e, z_a = model.encode(seen(batch.y[:11])).mean
        context = model.interaction.context(z_a, z_e)
        on_data = torch.stack([model.interaction(y, context) for y in batch.y[:11]])
        norm = on_data.norm(dim=-1).mean((0, 2))
        torch.testing.assert_close(loss(penalty="norm_data")[2]["penalty"], norm.detach(), rtol=1e-3, atol=1e-6)
        path = model.forecast(batch.y[0], z_e, z_a, torch.arange(11) * 0.1, Solver("rk4"))
        squares = torch.stack([model.interaction(y, context) for y in path]).square().mean((0, 2, 3))
        torch.testing.assert_close(loss()[2]["penalty"], squares.sqrt().detach(), rtol=1e-3, atol=1e-6)
        apart = torch.stack([model.interaction(y, context) for y in decorrelate(path)]).square().mean((0, 2, 3))
        torch.testing.assert_close(loss(penalty="rms_mixed")[2]["penalty"], apart.sqrt().detach(), rtol=1e-3, atol=1e-6)
        assert not torch.allclose(apart, squares, rtol=1e-2)

    def test_loss_is_the_lagrangian(self, loss):
        _, value, parts = loss(lambda0=[10.0, 20.0])
        torch.testing.assert_close(value, torch.tensor([10.0, 20.0]) * parts["data"] + parts["penalty"])

    def test_loss_normalisation(self, loss):
        _, value, parts = loss(loss_normalisation="first")
        torch.testing.assert_close(value, 10 + parts["penalty"])
        # The first value is that of the full window, however short the window still is.
        full = parts["data"]
        _, value, parts = loss(loss_normalisation="first", points=4)
        torch.testing.assert_close(value, 10 * parts["data"] / full + parts["penalty"])

    def test_supervision(self, loss):
        z_e, _ = loss.model.encode(seen(loss.batch.y[:11])).mean
        error = (z_e - loss.batch.z_e).square().sum(-1).mean(1)
        plain = loss()[1]
        torch.testing.assert_close(loss(supervised=1.0)[1], plain + error / (2 * 0.5**2))
        torch.testing.assert_close(loss(supervised=1.0, supervision="raw")[1], plain + error)
        assert torch.equal(loss(supervised=1.0, supervision="off")[1], plain)

    def test_supervision_of_z_a(self, loss):
        batch, model = loss.batch, loss.model
        _, z_a = model.encode(seen(batch.y[:11])).mean
        label, scale = z_a.detach() + 0.3, torch.tensor([[[0.5]], [[2.0]]])
        labelled = replace(batch, z_a=label)
        plain, parts = loss(batch=labelled, supervised=1.0)[1:]
        assert "z_a" not in parts, "the paper supervises z_e alone"
        keys = {"z_a_supervision_weight": 4.0, "z_a_scale": scale}
        value, parts = loss(batch=labelled, supervised=1.0, task_keys=keys)[1:]
        expected = 0.5 * (0.3 / scale.flatten()) ** 2 * z_a.shape[-1]
        torch.testing.assert_close(parts["z_a"], expected)
        torch.testing.assert_close(value, plain + 4 * expected)

    def test_observed_points_and_selection(self, data, tmp_path, settings):
        brief = but(settings.training, epochs=1)
        for choice, points in (("inclusive", 11), ("exclusive", 10)):
            job = but(settings, training=brief, choices=but(settings.choices, observed_points=choice))
            train(data, tmp_path / "m.st", tmp_path / "w", job, None)
            stored = store.load(tmp_path / "m.st")
            assert stored.card.observed == points
            task = task_of(TrainSettings(), stored.card, CPU)
            assert task.selection(Choices(selection="observed")) == range(1, points)
            assert task.selection(Choices(selection="forecast")) == range(points, 21)


def test_worst_case_sampling_draws_more_where_the_estimates_are_bad(trained, data, tmp_path, settings):
    """Without it the bits stay; with it the chosen share lies at the hardest z_e of a trial."""
    plain, _, header = augmented(trained, data, tmp_path, settings)
    off, _, _ = augmented(trained, data, tmp_path, settings, worst=0.0)
    assert torch.equal(plain.y, off.y) and "worst" not in header["options"]
    on, _, header = augmented(trained, data, tmp_path, settings, worst=1.0)
    again, _, _ = augmented(trained, data, tmp_path, settings, worst=1.0)
    assert torch.equal(on.y, again.y) and header["options"]["worst"] == 1.0
    stored = store.load(trained)
    task = task_of(stored.card.training, stored.card, CPU)
    real = StackedSet.of(Trajectories.load(data / "train.npz"), CPU)
    drawing = augmentation.Drawing(PRIOR, 0.01, stored.seeds, worst=1.0)
    hard = augmentation.hardest_parameters(stored.model, real, task, drawing, 0)
    assert hard.shape == (2, augmentation.TRIED // 4, 1)
    for place in range(2):
        away = (on.z_e[place] - hard[place].T).abs().amin(1)
        assert away.max() < 0.05 * 3.0
        # An encoder that has hardly learned says the same of all windows: the ends of the range are the hardest.
        assert (plain.z_e[place] - hard[place].T).abs().amin(1).max() > 0.2


def test_samples_that_run_away_for_ever_are_replaced_by_the_next_good_one_of_their_seed():
    y = torch.arange(10.0).view(1, 2, 5, 1)
    good = torch.tensor([[True, False, False, True, False], [False] * 5])
    task = SimpleNamespace(bound=torch.tensor([7.5]))
    inputs = y + 100
    y, z_e, z_a, u = augmentation._replace_diverged(y, y[0].clone(), y[0].clone(), inputs, good, task)
    assert torch.equal(z_a, z_e)
    assert torch.equal(u[0, 0], z_e[0] + 100) and torch.equal(inputs, torch.arange(100.0, 110.0).view(1, 2, 5, 1))
    assert y[0, 0, :, 0].tolist() == z_e[0, :, 0].tolist() == [0, 3, 3, 3, 0]
    assert y[0, 1, :, 0].tolist() == [5, 6, 7, 7.5, 7.5] and z_e[1, :, 0].tolist() == [5, 6, 7, 8, 9]
