"""Sets of measurements: no point in two of them, whatever divides them."""

import numpy as np
import pytest
from swings import NAMES, STEP, settings, swing, table, trials

from expertaug.errors import InputError
from expertaug.measurements.cut import divide, measure, sets_of
from expertaug.measurements.settings import Label, SplitSettings

RULES = (
    SplitSettings(by="random", seed=3),
    SplitSettings(by="random", pieces="trajectories"),
    SplitSettings(by="time"),
    SplitSettings(by="time", reverse=True, guard_s=0.2),
    SplitSettings(by="quantity", quantity="omega**2 / 2 - 4 * cos(theta)"),
    SplitSettings(by="quantity", quantity="abs(theta)", statistic="max", pieces="trajectories", reverse=True),
    SplitSettings(by="quantity", quantity="trial", thresholds=(2.5, 3.5)),
    SplitSettings(by="column", column="trial", train=["0", "1", "5"], validation="2", test=["3", "4"]),
)


def spans(sets):
    """Per set, the (trajectory, row) that its chunks hold."""
    each = {}
    for name, chunks in sets.items():
        split = [identity.rsplit("/", 1) for identity in chunks.id]
        each[name] = {(where, int(row) + k) for where, row in split for k in range(len(chunks.t))}
    return each


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: "-".join(map(str, rule.dump().values()))[:40])
def test_no_point_is_in_two_sets(tmp_path, rule):
    data = measure(settings(trials(tmp_path), split=rule), NAMES)
    found, _, _ = sets_of(data)
    each = spans(found)
    assert all(len(one) for one in found.values())
    for a, b in (("train", "validation"), ("train", "test"), ("validation", "test")):
        assert not each[a] & each[b]
    if rule.guard_s:
        near = {(where, row + d) for where, row in each["train"] for d in (-4, 4)}
        assert not near & each["validation"]


def test_small_swings_train_and_large_ones_test_and_the_other_way_round(tmp_path):
    path = trials(tmp_path)
    for reverse in (False, True):
        rule = SplitSettings(by="quantity", quantity="abs(theta)", statistic="max", reverse=reverse)
        data = measure(settings(path, split=rule), NAMES)
        found, _, thresholds = sets_of(data)
        size = {name: np.abs(one.y[..., 0]).max(1).mean() for name, one in found.items()}
        order = ("test", "validation", "train") if reverse else ("train", "validation", "test")
        assert size[order[0]] < size[order[1]] < size[order[2]]
        assert thresholds["train_below"] < thresholds["test_above"]


def test_files_by_name(tmp_path):
    for name in ("train_a", "train_b", "validation_a", "far"):
        table(tmp_path / f"{name}.csv", {"t": STEP * np.arange(60), "angle": swing(1.0)[:60, 0]})
    rule = SplitSettings(by="file", train="train_*", validation=["validation_*"], test=["far.csv"])

    def divided(rule):
        given = settings(f"{tmp_path}/*.csv", trajectory=None, columns={"theta": "angle"}, split=rule)
        return sets_of(measure(given, NAMES))

    found, _, _ = divided(rule)
    assert {name: {i.rpartition("/")[0] for i in one.id} for name, one in found.items()} == {
        "train": {"train_a", "train_b"},
        "validation": {"validation_a"},
        "test": {"far"},
    }
    for test, message in (
        ("near", r"split.test: no file is 'near'; there are 'far.csv'"),
        ("*", "is in train and test; each belongs to one set"),
    ):
        with pytest.raises(InputError, match=message):
            divided(rule.model_copy(update={"test": test}))


def test_time_trains_on_the_beginning_unless_reversed(tmp_path):
    path = trials(tmp_path, count=1)
    for reverse, first in ((False, 0), (True, 2)):
        labels, _ = divide(measure(settings(path, split=SplitSettings(by="time", reverse=reverse)), NAMES))
        assert labels[0][0] == first and labels[0][-1] == 2 - first
        assert (labels[0] == 0).sum() == 120


def test_of_two_trajectories_one_trains_and_the_halves_of_the_other_validate_and_test(tmp_path):
    path = trials(tmp_path, count=2, points=24)
    whole = SplitSettings(by="random", pieces="trajectories")
    trains = []
    for seed in range(4):
        split = whole.model_copy(update={"seed": seed})
        labels, _ = divide(measure(settings(path, length=8, evaluation_stride=4, split=split), NAMES))
        trains.append(int((labels[0] == 0).all()))
        other = labels[trains[-1]]
        assert (labels[1 - trains[-1]] == 0).all()
        assert (other[:12] == 1).all() and (other[12:] == 2).all()
    assert set(trains) == {0, 1}
    with pytest.raises(InputError, match="there are 1 pieces"):
        divide(measure(settings(trials(tmp_path, count=1), split=whole), NAMES))


def test_random_depends_on_the_seed_alone(tmp_path):
    data = [measure(settings(trials(tmp_path), split=SplitSettings(by="random", seed=s)), NAMES) for s in (1, 1, 2)]
    one, same, other = (np.concatenate(divide(d)[0]) for d in data)
    assert np.array_equal(one, same) and not np.array_equal(one, other)


def test_labels_known_in_part_and_from_the_start(tmp_path):
    path = trials(tmp_path, count=3)
    lines = path.read_text().splitlines()
    known = {0: "2.0", 1: "", 2: "2.5"}
    lines = [f"{lines[0]},frequency", *(f"{line},{known[int(float(line.split(',')[0]))]}" for line in lines[1:])]
    path.write_text("\n".join(lines))
    given = settings(path, z_e={"omega0": "frequency"}, split=SplitSettings(by="time"))
    found = sets_of(measure(given, NAMES))[0]["train"]
    of = {k: found.z_e[[i.startswith(f"swings/{k}/") for i in found.id], 0] for k in range(3)}
    assert (of[0] == 2.0).all() and np.isnan(of[1]).all() and (of[2] == 2.5).all()
    given = settings(path, z_e={"omega0": Label(start="omega")}, split=SplitSettings(by="time"))
    found = sets_of(measure(given, NAMES))[0]["train"]
    assert np.array_equal(found.z_e[:, 0], found.y[:, 0, 1])
    path.write_text("\n".join([*lines[:5], lines[5].replace(",2.0", ",2.1"), *lines[6:]]))
    with pytest.raises(InputError, match=r"omega0 is 2 in row 2 and 2.1 in row 6; a parameter is constant"):
        measure(settings(path, z_e={"omega0": "frequency"}), NAMES)
