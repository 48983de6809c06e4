"""Values that nobody measured: they change no loss, no metric and no fit, and first points are inferred."""

from functools import partial

import numpy as np
import pytest
import torch
from swings import NAMES, settings, trials

import expertaug as ea
from cards import card
from expertaug.evaluation.metrics import parameter_errors
from expertaug.inference.settings import RefinementSettings
from expertaug.inference.window_problem import assumed_noise
from expertaug.learning.residuals import mean_squared_error, squared_errors, squares
from expertaug.measurements.cut import measure, sets_of
from expertaug.measurements.settings import SplitSettings
from expertaug.models.gaps import Gaps, ranges_of
from expertaug.models.observation_noise import noise_of, of_observed
from expertaug.systems.pendulum import DampedPendulum
from expertaug.windows import fill
from seen import seen

SYSTEM = DampedPendulum()
NAN = float("nan")
SMALL = {"windows": {"theta": (0, 0.5), "omega": (0, 0.5)}, "layers": (8,), "latent": 1}


def states(*shape, gaps=0.3):
    generator = torch.Generator().manual_seed(int(1000 * gaps))
    y = torch.randn(*shape, 2, generator=generator, dtype=torch.float64)
    return y, torch.where(torch.rand(y.shape, generator=generator) < gaps, NAN, y)


def test_losses_and_metrics_are_those_of_the_measured_values():
    forecast, _ = states(6, 2, 5, gaps=0.0)
    truth, seen = states(6, 2, 5)
    known = ~seen.isnan()
    expected = torch.stack([(forecast - truth).square()[:, s][known[:, s]].mean() for s in range(2)])
    assert torch.allclose(mean_squared_error(SYSTEM, forecast, seen), expected)
    good = torch.tensor([[True, True, False, True, True], [True] * 5])
    only = torch.stack([(forecast - truth).square()[:, s, good[s]][known[:, s, good[s]]].mean() for s in range(2)])
    assert torch.allclose(mean_squared_error(SYSTEM, forecast, seen, good), only)
    sums, counts = squares(SYSTEM, forecast, seen)
    assert torch.equal(counts, known.sum((0, 3))) and torch.allclose(
        sums.sum(), (forecast - truth).square()[known].sum()
    )
    of_each = squared_errors(SYSTEM, forecast, seen)
    by_hand = sum(
        np.nanmean(np.where(known[:, 0, 0, k], (forecast - truth)[:, 0, 0, k] ** 2, np.nan)) for k in range(2)
    )
    assert float(of_each[0, 0]) == pytest.approx(by_hand)
    untold = seen.clone()
    untold[:, :, 3] = NAN
    assert squared_errors(SYSTEM, forecast, untold)[:, 3].isnan().all()


def test_no_gradient_is_lost_to_what_is_not_measured():
    forecast, _ = states(6, 2, 5, gaps=0.0)
    _, seen = states(6, 2, 5)
    forecast.requires_grad_()
    mean_squared_error(SYSTEM, forecast, seen).sum().backward()
    assert torch.isfinite(forecast.grad).all() and torch.equal(forecast.grad == 0, seen.isnan())


def test_all_measured_is_what_it_was_to_the_bit():
    forecast, _ = states(6, 2, 5, gaps=0.0)
    truth, _ = states(6, 2, 5)
    plain = (forecast - truth).square().movedim(1, 0).flatten(1).mean(1)
    assert torch.equal(mean_squared_error(SYSTEM, forecast, truth), plain)
    assert squares(SYSTEM, forecast, truth)[1] == 12


def test_straight_lines_stand_for_gaps():
    t = torch.tensor([0.0, 1.0, 3.0, 4.0])
    y = torch.tensor([[NAN, 1.0], [2.0, NAN], [NAN, NAN], [8.0, 7.0]]).unsqueeze(1)
    found = fill(y, t, torch.tensor([0.0, 0.0])).squeeze(1)
    assert torch.allclose(found, torch.tensor([[2.0, 1.0], [2.0, 2.5], [6.0, 5.5], [8.0, 7.0]]))
    nothing = torch.full((4, 1, 2), NAN)
    assert torch.equal(fill(nothing, t, torch.tensor([1.0, -1.0]))[:, 0], torch.tensor([[1.0, -1.0]] * 4))
    whole, _ = states(4, 3)
    assert fill(whole, t, torch.zeros(2)) is whole


def test_first_points_are_what_was_measured_or_within_their_range():
    gaps = Gaps(SYSTEM, torch.arange(4.0), {"theta": [-1, 1], "omega": [5, 7]})
    _, y = states(4, 50)
    y = y.float()
    found, known = gaps.start(seen(y)), ~y[0].isnan()
    assert torch.equal(found[known], y[0][known])
    assert ((found[:, 1] >= 5) & (found[:, 1] <= 7))[~known[:, 1]].all()
    assert ranges_of(["a", "b"], [0.0, np.inf], [1.0, -np.inf], {"b": [2, 3]}) == {"a": [-0.1, 1.1], "b": [2.0, 3.0]}


def test_parameters_are_scored_where_they_are_known():
    truth = torch.tensor([[[2.0], [NAN], [4.0]]])
    found = parameter_errors(SYSTEM, torch.tensor([[[2.2], [9.0], [4.0]]]), truth)
    assert float(found["relative_error"]) == pytest.approx(5.0)
    assert float(found["rmse_omega0"]) == pytest.approx(0.2 / 2**0.5)
    assert parameter_errors(SYSTEM, truth, torch.full_like(truth, NAN)) == {}


def test_noise_of_each_component():
    assert noise_of({"theta": 0.1}, SYSTEM, card({}, t=[0.0], observed=1)) == [0.1, 0.0]
    assert noise_of("estimated", SYSTEM, card({"data_noise": [0.1, 0.2]}, t=[0.0], observed=1)) == [0.1, 0.2]
    with pytest.raises(ea.InputError, match=r"noise.phi: 'phi' is no component of the state; known: theta, omega"):
        noise_of({"phi": 0.1}, SYSTEM, card({}, t=[0.0], observed=1))
    double = ea.DoublePendulum(expert="point_mass")
    assert torch.allclose(
        of_observed([0.1, 0.2, 1.0, 1.0], double), torch.tensor([0.1, 0.2, 0.1, 0.2], dtype=torch.float64)
    )
    assert assumed_noise(RefinementSettings(), [0.1, 0.0], [10.0, 20.0]) == [0.1, 1e-3 * 20.0 / 10.0]


@pytest.fixture
def angle_alone(tmp_path):
    """Sets in which the speed has no column and some angles are missing."""
    path = trials(tmp_path, noise=0.005)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line for k, line in enumerate(lines) if k == 0 or k % 13))
    given = settings(path, columns={"theta": "angle"}, length=40, split=SplitSettings(by="time"))
    return sets_of(measure(given, NAMES))[0]


def test_least_squares_finds_parameter_and_speed_from_the_angle_alone(angle_alone):
    model = ea.least_squares(
        SYSTEM,
        angle_alone["train"],
        observed_s=1.5,
        prior={"omega0": (0.5, 4)},
        noise="estimated",
        start={"omega": (-4, 4)},
    )
    test = angle_alone["train"]
    found = model.forecast(test.seen[:, :31], test.t)
    # The swings rub a little, which the expert does not know: 2.0 is their frequency.
    assert np.median(np.abs(found.z_e["omega0"] - 2.0)) < 0.08
    later = test.seen[:, 31:, 0] - found.y[:, 31:, 0]
    assert np.sqrt(np.nanmean(later**2)) < 0.05


@pytest.mark.slow
def test_a_network_learns_from_the_angle_alone(angle_alone, tmp_path):
    train, validation = angle_alone["train"], angle_alone["validation"]
    model = ea.HybridModel(SYSTEM, partial(ea.WindowEncoder, **SMALL), partial(ea.MLPInteraction, layers=(4,)))
    options = {"observed_s": 1.0, "epochs": 30, "batch_size": 20, "learning_rate": 1e-2, "seeds": range(2)}
    with pytest.raises(ea.InputError, match=r"start.omega: missing, nobody measured it; give the range"):
        ea.fit(model, train, validation, **options)
    fit = ea.fit(model, train, validation, start={"omega": (-4, 4)}, **options)
    loss = fit.history[fit.history["metric"] == "data"].groupby("step")["value"].mean()
    assert loss.iloc[-1] < 0.3 * loss.iloc[0]
    plus = ea.finetune(fit, train, validation, prior={"omega0": (1, 3)}, noise="estimated", epochs=1)
    window = train.seen[:, :21]
    y = plus.forecast(window, train.t).y
    assert np.isfinite(y).all() and np.allclose(y[:, :, 0, 0], train.y[:, 0, 0])
    plus.save(tmp_path / "model.safetensors")
    assert np.array_equal(ea.load(tmp_path / "model.safetensors").forecast(window, train.t).y, y)
    scores = ea.evaluate(plus, angle_alone["test"])
    assert not scores["metric"].str.startswith("relative").any() and np.isfinite(scores["value"]).all()
    # What stands where nothing was measured is of no consequence.
    other = np.where(train.mask, train.y, 77.0)
    changed = ea.Trajectories(train.t, other, train.z_e, id=train.id, mask=train.mask, noise=train.noise)
    again = ea.fit(model, changed, validation, start={"omega": (-4, 4)}, **options)
    assert np.array_equal(again.forecast(window, train.t).y, fit.forecast(window, train.t).y)
