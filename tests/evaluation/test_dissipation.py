"""Power that models dissipate beside the loss of energy: of a friction that is known."""

import math
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from rubbing_pendulum import JOB, T, asked, motion, pendulum
from torch import nn

from cards import card

sys.path.insert(0, str(Path(__file__).parents[1] / "recordings"))
from pendulum_motion import CONSTANTS, FRICTION

from expertaug.cli import main
from expertaug.errors import InputError
from expertaug.evaluation.dissipation import Loss, dissipated_power, draw, measured_loss
from expertaug.evaluation.dissipation import run_stage as dissipation
from expertaug.models import store
from expertaug.models.decoder import Decoder
from expertaug.models.posterior import Estimates
from expertaug.systems.double_pendulum import accelerations
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.settings import CONSERVING
from expertaug.trajectories import Trajectories


class Friction(nn.Module):
    """F_a: what both joints' friction adds to the expert without one; ``share`` of it, and z_a times that."""

    def __init__(self, share=1.0):
        super().__init__()
        self.share = share

    def context(self, z_a, z_e):
        return z_a

    def forward(self, y, context):
        rubbed = accelerations(y, CONSTANTS, FRICTION) - accelerations(y, CONSTANTS)
        return torch.cat((torch.zeros_like(rubbed), self.share * context * rubbed), -1)


def loss(chunks):
    """Of the true pendulum, (N,)."""
    y = torch.from_numpy(chunks.y).movedim(1, 0)
    return measured_loss(pendulum(), torch.from_numpy(chunks.t), y, torch.zeros(len(chunks), 2)).numpy()


CONSERVED = {
    "pendulum": (DampedPendulum(), torch.tensor([1.7], dtype=torch.float64)),
    "double_pendulum": (pendulum(), torch.zeros(2, dtype=torch.float64)),
}


@pytest.mark.parametrize("name", CONSERVING)
def test_the_expert_conserves_the_energy(name):
    torch.manual_seed(0)
    system, z_e = CONSERVED[name]
    y = 3 * torch.randn(50, len(system.state), dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(system.energy(y, z_e).sum(), y)
    rates = system.expert(torch.zeros(()), y, z_e)
    size = (gradient * rates).abs().sum(-1)
    assert (size > 0).all() and ((gradient * rates).sum(-1).abs() < 1e-12 * size).all()


def test_states_that_nobody_measured_are_left_out():
    y = torch.from_numpy(motion(6).y).double().movedim(1, 0)
    whole = measured_loss(pendulum(), torch.from_numpy(T), y, torch.zeros(6, 2))
    y[3, :, 1] = torch.nan
    y[:, 2] = torch.nan
    found = measured_loss(pendulum(), torch.from_numpy(T), y, torch.zeros(6, 2))
    assert found[2].isnan() and torch.allclose(found[[0, 1, 3, 4, 5]], whole[[0, 1, 3, 4, 5]], rtol=0.1, atol=0.1)
    power = dissipated_power(Decoder(pendulum(friction=FRICTION)), y.float().unsqueeze(1), None)
    assert power[0, 2].isnan() and power[0, [0, 1]].isfinite().all()


def test_a_known_friction_dissipates_what_is_lost():
    """To 1 %: the median of slopes between points .19 s apart at most is not quite the mean rate."""
    chunks = motion()
    measured = loss(chunks)
    states = torch.from_numpy(chunks.y).movedim(1, 0).unsqueeze(1).expand(-1, 2, -1, -1)
    one = torch.ones(2, len(chunks), 1)
    one[1] = 0.5
    found = Estimates(states[0], states[0, ..., 2:], one)
    power = dissipated_power(Decoder(pendulum(), Friction()), states, found)
    assert power.shape == (2, len(chunks))
    assert measured.mean() > 1.0
    assert power[0].mean() == pytest.approx(measured.mean(), rel=0.01)
    torch.testing.assert_close(power[1], power[0] / 2, rtol=1e-3, atol=1e-3)
    known = dissipated_power(Decoder(pendulum(friction=FRICTION)), states, None)
    torch.testing.assert_close(known[0], power[0], rtol=1e-3, atol=1e-3)
    none = dissipated_power(Decoder(pendulum()), states, None)
    assert none.abs().max() < 1e-3 * power[0].mean()


def test_slopes_hardly_feel_one_bad_point():
    chunks = motion(10)
    y = chunks.y.copy()
    y[:, 7, 2] += 5.0
    bad = Trajectories(chunks.t, y, chunks.z_e)
    np.testing.assert_allclose(loss(bad), loss(chunks), rtol=0.2, atol=0.1)


def save(path, method, seeds=(0, 1), friction=None, name="double_pendulum"):
    """A model file of the expert alone, with a friction that it knows."""
    system = pendulum(friction=friction)
    described = {"kind": "least_squares", "method": method, "seeds": list(seeds), "t": T.tolist(), "observed": 11}
    described["system"] = {"name": name, "expert": "compound", "constants": CONSTANTS.to_dict()}
    described["system"] |= {} if friction is None else {"friction": list(friction)}
    store.save(path, Decoder(system), card(described))
    return path


@pytest.fixture
def folder(tmp_path):
    for k, name in enumerate(("train", "validation", "test")):
        motion(20, k).save(tmp_path / f"{name}.npz")
    save(tmp_path / "a.safetensors", "rubbing", friction=FRICTION)
    save(tmp_path / "b.safetensors", "half", friction=tuple(f / 2 for f in FRICTION))
    return tmp_path


def test_the_stage_by_recording(folder, drawn):
    outputs = [folder / f"out.{end}" for end in ("csv", "md", "tex", "png", "pdf")]
    models = [folder / "b.safetensors", folder / "a.safetensors"]
    dissipation(models, folder, outputs, JOB)
    table = pd.read_csv(outputs[0])
    assert len(table) == 2 * 2 * 3 * 2, "versions, seeds, sets, recordings"
    assert set(table["recording"]) == {"a", "b"} and (table["chunks"] == 10).all()
    whole, half = (table[table["method"] == name].reset_index() for name in ("rubbing", "half"))
    np.testing.assert_allclose(whole["dissipated"], whole["measured"], rtol=0.1)
    np.testing.assert_allclose(half["dissipated"], whole["dissipated"] / 2, rtol=1e-4)
    text = outputs[1].read_text()
    first = whole[whole["set"] == "train"]
    decimals = 2 - math.floor(math.log10(first["measured"].iloc[0]))
    mean, error = (f"{first[column].iloc[0]:.{decimals}f}" for column in ("measured", "measured_se"))
    assert f"| train | a | 10 | {mean} ± {error} |" in text
    assert f"| train | With friction | {first['measured'].mean():.{decimals}f} |" in text
    assert outputs[2].read_text().isascii() and r"\nabla" in outputs[2].read_text()
    assert len(drawn[0].axes) == 3 and [len(line.get_xdata()) for line in points(drawn[0].axes[0])] == [2, 2]
    assert all(axis.get_xscale() == "linear" for axis in drawn[0].axes)
    assert [text.get_text() for text in drawn[0].axes[0].get_yticklabels()] == ["With friction", "Half of it"]
    labels = [text.get_text() for text in drawn[0].legends[0].get_texts()]
    assert labels == ["measured loss", "± 2 standard errors"]


def points(axis):
    """The lines of a panel that have markers: a version each."""
    return [line for line in axis.lines if line.get_linestyle() == "None"]


def test_the_figure_has_means_over_the_chunks_of_all_recordings():
    chunks, measured, error = {"a": 30, "b": 10}, {"a": 1.0, "b": 5.0}, {"a": 0.1, "b": 0.4}
    losses = [
        Loss("e", "whole", "Whole", seed, "", "test", r, chunks[r], measured[r], error[r], measured[r] * (seed + 1))
        for r in "ab"
        for seed in range(2)
    ]
    (axis,) = draw(losses, asked(whole="Whole")).axes
    assert points(axis)[0].get_xdata() == pytest.approx([2.0, 4.0])
    assert axis.lines[0].get_xdata() == pytest.approx([2.0, 2.0])
    shade = axis.patches[0].get_extents().transformed(axis.transData.inverted())
    spread = 2 * math.hypot(0.75 * 0.1, 0.25 * 0.4)
    assert (shade.x0, shade.x1) == pytest.approx((2.0 - spread, 2.0 + spread))


def test_a_model_that_dissipates_far_too_much_leaves_the_others_their_room():
    rows = [("whole", 2.0), ("half", 1.0), ("half~refined", -300.0)]
    losses = [Loss("e", name, name, 0, "", "test", r, 9, 2.0, 0.1, lost) for name, lost in rows for r in "ab"]
    job = asked(**{name: name for name, _ in rows})
    (axis,) = draw(losses, job).axes
    assert axis.get_xscale() == "symlog" and list(axis.get_xticks()) == [-1000, -2, 0, 2, 1000]
    assert axis.get_xlim()[0] < -1000 and axis.get_xlim()[1] > 1000
    assert [line.get_marker() for line in points(axis)] == ["o", "o", "s"]
    assert all(line.get_markerfacecolor() != "none" for line in points(axis))
    only = [loss for loss in losses if loss.method != "half~refined"]
    far = [Loss("e", "half~refined", "", 0, "", "test", "a", 9, 2.0, 0.1, 300.0)]
    (axis,) = draw([*only, *far], job).axes
    assert -2 < axis.get_xlim()[0] < 0, "nothing is below zero"


def test_refusals(folder, capsys):
    with pytest.raises(InputError, match="half: no model of this version"):
        dissipation([folder / "a.safetensors"], folder, [folder / "o.csv"], JOB)
    other = save(folder / "c.safetensors", "third")
    with pytest.raises(InputError, match="a model of 'third'; give those of rubbing, half"):
        dissipation([other], folder, [folder / "o.csv"], JOB)
    arguments = ["dissipation", str(other), "--data", str(folder), "--output", str(folder / "o.csv")]
    assert main([*arguments, "--settings", JOB.model_dump_json()]) == 2
    assert "third" in capsys.readouterr().err
