"""A prior that finds its own width: it covers where the windows lie, and says where the expert does not fit."""

from __future__ import annotations

import pytest
from fitted_pendulum import NOISE, OBSERVED, expert_alone, pendulum

from expertaug.errors import InputError
from expertaug.evaluation.own_priors import run_stage as own_priors
from expertaug.evaluation.settings import OwnPriorsJob
from expertaug.inference.adaptive_prior import adapt_prior, typical_ranges, widen_prior, with_more_starts
from expertaug.inference.adaptive_prior import run_stage as stage
from expertaug.inference.settings import FirstPriorJob
from expertaug.learning.settings import Build, SolverOnly
from expertaug.models.fit_settings import RefinementSettings
from expertaug.models.settings import PartsSettings
from expertaug.stages.prior_file import read_ranges, with_ranges
from expertaug.systems.double_pendulum import DoublePendulum
from expertaug.systems.rlc import RLC
from expertaug.windows import Windows
from tiny import SETTINGS, of_kind

SEEN = {"omega0": (1.5, 3.1)}


def first_points(data):
    return Windows.of(data).until(OBSERVED)


@pytest.fixture(scope="module")
def train():
    return pendulum(SEEN["omega0"], n=60)


def test_it_grows_to_where_the_windows_are_and_no_further(train):
    far = pendulum((0.5, 1.5), n=60)
    found = adapt_prior(expert_alone("pendulum", train), first_points(train), first_points(far), NOISE, SEEN)
    low, high = found.ranges["omega0"]
    assert 0.3 < low < far.z_e.min() * 1.05 and 3.0 < high < 3.6
    assert 1.4 < found.training["omega0"][0] < found.training["omega0"][1] < 3.2
    assert found.explained > 0.9 and "explains" in found.says


def test_windows_of_the_training_leave_the_ranges_as_they_are(train):
    found = adapt_prior(expert_alone("pendulum", train), first_points(train), first_points(train), NOISE, SEEN)
    assert found.ranges == found.training and found.explained > 0.95


@pytest.mark.slow
def test_it_says_when_the_expert_itself_does_not_fit(train):
    damped = pendulum((1.5, 3.1), damping=(0.4, 0.6), n=40)
    found = adapt_prior(expert_alone("pendulum", train), first_points(train), first_points(damped), NOISE, SEEN)
    assert found.explained < 0.5 and "does not fit" in found.says


@pytest.mark.slow
def test_without_windows_the_ranges_end_at_the_budget(train):
    whole = Windows.of(train)
    stored = expert_alone("pendulum", train)
    found = widen_prior(stored, whole, NOISE, 2.0, SEEN)
    low, high = found.ranges["omega0"]
    assert low == pytest.approx(found.training["omega0"][0] / 2) and found.rounds == 2
    assert high == pytest.approx(found.training["omega0"][1] * 2) and not found.windows
    assert "no windows were given" in found.says and found.explained > 0.7
    with pytest.raises(InputError, match="budget: found 1"):
        widen_prior(stored, whole, NOISE, 1.0, SEEN)


@pytest.mark.slow
def test_nothing_is_widened_where_own_windows_cannot_be_fitted(train):
    """One start for the fits: beyond a factor of two they end in minima of other swings."""
    whole = Windows.of(train)
    few = RefinementSettings(starts=1, tries=1, steps=30)
    found = widen_prior(expert_alone("pendulum", train), whole, NOISE, 100.0, SEEN, few)
    assert found.ranges["omega0"][1] < 50


def test_a_search_from_nothing_starts_around_the_typical_size():
    system = DoublePendulum(expert="point_mass")
    found = typical_ranges(system)
    assert found["omega1"] == (-100.0, 100.0) and typical_ranges(RLC())["L"] == (0.2, 20.0)
    few = RefinementSettings(starts=3, tries=2)
    assert (
        with_more_starts(few) == RefinementSettings(starts=256, tries=2)
        and with_more_starts(RefinementSettings()).starts == 256
    )


def test_the_stage_writes_ranges_that_other_stages_read(data, tmp_path):
    job = of_kind(
        FirstPriorJob,
        SETTINGS,
        build=Build(kind="least_squares"),
        model=PartsSettings(),
        training=SolverOnly(),
        windows=["test"],
        budget=2.0,
        noise=0.01,
        refinement=RefinementSettings(starts=16, tries=1),
    )
    found = stage(None, data, tmp_path / "prior.json", job)
    ranges = read_ranges(tmp_path / "prior.json")
    assert ranges == {"omega0": list(found.ranges["omega0"])} and 0 < ranges["omega0"][0] < 3.1
    settings = {"prior": "own", "refinement": {"prior": "own", "noise": 0.0}, "system": {"name": "pendulum"}}
    filled = with_ranges(settings, ranges)
    assert filled["prior"] == ranges and filled["refinement"]["prior"] == ranges and settings["prior"] == "own"
    assert with_ranges({"prior": {"omega0": [1, 2]}}, None) == {"prior": {"omega0": [1, 2]}}
    with pytest.raises(InputError, match="--prior: missing"):
        with_ranges(settings, None)
    (tmp_path / "other.json").write_text("[]")
    with pytest.raises(InputError, match="holds no ranges"):
        read_ranges(tmp_path / "other.json")
    table = [tmp_path / f"own.{end}" for end in ("csv", "md", "tex")]
    own_priors(
        [tmp_path / "prior.json"], table, OwnPriorsJob(experiment="pendulum", priors=[("before training", "all")])
    )
    assert "| before training | all | omega0 | [" in table[1].read_text(encoding="utf-8")


def test_mistakes_are_one_line(train):
    stored, y = expert_alone("pendulum", train), first_points(train)
    with pytest.raises(InputError, match="give ranges"):
        adapt_prior(stored, y, y, NOISE)
    with pytest.raises(InputError, match="the training's are"):
        adapt_prior(stored, y, y.until(OBSERVED - 1), NOISE, SEEN)
    with pytest.raises(InputError, match=r"units\.omga: 'omga' is no expert parameter"):
        adapt_prior(stored, y, y, NOISE, SEEN, RefinementSettings(units={"omga": "window"}))
