import json

import numpy as np
import pandas as pd
import pytest
from angle_files import write_angles
from pendulum_motion import CONSTANTS, real_recordings, truth

from expertaug.errors import InputError
from expertaug.measurements.settings import ChunkLimits
from expertaug.measurements.splitting import SPLITS
from expertaug.trajectories import Trajectories
from expertaug_recordings.angles.measure import run_stage as measure_angles
from expertaug_recordings.chunks import cut_horizon, split_chunks
from expertaug_recordings.ibm import import_markers, list_marker_files
from expertaug_recordings.settings import ChunkKeys, CutHorizonJob, ImportMarkersJob, MeasureAnglesJob, SplitChunksJob
from nightly import others_slow

SMALL = {"min_chunks": 1, "guard_s": 0.0}


def frames_of(folder, step=4, length=20):
    """Per split, the set of (recording, frame) that its chunks span, between their points included."""
    table = pd.read_csv(folder / "chunks.csv", dtype={"recording": str})
    span = (length - 1) * step + 1
    return {
        name: {(r, f + k) for r, f in zip(part["recording"], part["first_frame"], strict=True) for k in range(span)}
        for name, part in table.groupby("split")
    }


@pytest.mark.parametrize("by", ["energy", "time"])
@pytest.mark.parametrize("seed", others_slow(range(8), 3))
def test_no_frame_is_in_two_splits_and_none_is_unmeasured(tmp_path, by, seed):
    rng = np.random.default_rng(seed)
    angles, unmeasured = [], set()
    for k, y in enumerate(truth()[:, :8000]):
        y = y[: int(rng.integers(4000, 8000))]
        starts, lengths = rng.integers(0, len(y) - 60, size=(2, 6)), rng.integers(1, 60, size=(2, 6))
        gaps, half = (list(zip(s, s + n, strict=True)) for s, n in zip(starts, lengths, strict=True))
        angles.append(write_angles(tmp_path / f"r{k}", y, gaps=gaps, half=half))
        unmeasured |= {(f"r{k}", f) for a, b in gaps + half for f in range(a, b)}
    settings = SplitChunksJob(
        by=by,
        stride=int(rng.integers(1, 21)),
        evaluation_stride=int(rng.integers(1, 21)),
        phases=str(rng.choice(["all", "first"])),
        guard_s=float(rng.choice([0.0, 0.06])),
        min_chunks=1,
    )
    split_chunks(angles, tmp_path / "data", settings)
    frames = frames_of(tmp_path / "data")
    assert set(frames) == set(SPLITS)
    for a, b in (("train", "validation"), ("train", "test"), ("validation", "test")):
        assert not frames[a] & frames[b]
        if settings.guard_s:  # nor do the smoothing windows of 24 frames on either side touch
            assert not {(r, f + d) for r, f in frames[a] for d in (-48, -24, 24, 48)} & frames[b]
    for name in SPLITS:
        assert not frames[name] & unmeasured


def test_chunks_hold_the_states_of_their_frames(tmp_path):
    y = truth()[0, :8000]
    split_chunks([write_angles(tmp_path / "r0", y)], tmp_path / "data", SplitChunksJob(**SMALL, stride=7))
    table = pd.read_csv(tmp_path / "data" / "chunks.csv")
    for name in SPLITS:
        chunks, rows = Trajectories.load(tmp_path / "data" / f"{name}.npz"), table[table["split"] == name]
        assert np.array_equal(rows["chunk"], np.arange(len(chunks)))
        assert chunks.id.tolist() == [f"r0/{frame}" for frame in rows["first_frame"]]
        points = y[rows["first_frame"].to_numpy()[:, None] + 4 * np.arange(20)]
        turns = (points - chunks.y)[..., :2] / (2 * np.pi)
        assert np.abs(turns - np.round(turns[:, :1])).max() < 1e-5
        assert np.abs(chunks.y[:, 0, :2]).max() <= np.pi + 1e-5
        assert np.allclose(chunks.y[..., 2:], points[..., 2:], atol=1e-4)
        assert np.array_equal(chunks.z_e, chunks.y[:, 0, 2:]) and chunks.z_a.shape[1] == 0
        assert np.allclose(chunks.t, np.arange(20) / 100)


def test_energy_rule_orders_the_splits(tmp_path):
    angles = [write_angles(tmp_path / f"r{k}", y) for k, y in enumerate(truth())]
    split_chunks(angles, tmp_path / "data", SplitChunksJob(**SMALL, phases="first", stride=20))
    table = pd.read_csv(tmp_path / "data" / "chunks.csv").groupby("split")["energy"]
    report = json.loads((tmp_path / "data" / "splits.json").read_text())
    low, high = report["thresholds"]["train_below"], report["thresholds"]["test_above"]
    # A chunk's mean energy may differ a little from that of the segment that it was cut from.
    assert table.max()["train"] < low * 1.02 and table.min()["test"] > high * 0.98
    assert low * 0.98 < table.min()["validation"] and table.max()["validation"] < high * 1.02
    counts = np.array([report["chunks"][name] for name in SPLITS])
    assert counts / counts.sum() == pytest.approx([0.4, 0.3, 0.3], abs=0.02)
    assert report["energy_constants"]["G1"] == pytest.approx(CONSTANTS.G1, rel=0.02)


def test_time_rule_takes_test_from_the_start(tmp_path):
    job = SplitChunksJob(**SMALL, by="time", stride=1)
    split_chunks([write_angles(tmp_path / "r0", truth()[0])], tmp_path / "data", job)
    first = pd.read_csv(tmp_path / "data" / "chunks.csv").groupby("split")["first_frame"]
    assert (first.min()["test"], first.min()["validation"], first.min()["train"]) == (0, 4800, 9600)
    assert first.max()["test"] == 4800 - 77 and first.max()["train"] == 16000 - 77


def test_stride_phases_and_a_lower_analysis_rate(tmp_path):
    def count(rate, **settings):
        angles = write_angles(tmp_path / "r0", truth()[0][:: int(400 / rate)], rate)
        job = SplitChunksJob(**SMALL, by="time", evaluation_stride=20, **settings)
        split_chunks([angles], tmp_path / "data", job)
        return json.loads((tmp_path / "data" / "splits.json").read_text())["chunks"]["train"]

    assert count(400, stride=20, phases="first") == 80  # 16 s of .2 s
    assert count(400, stride=20, phases="all") == 320
    assert count(400, stride=1, phases="first") == 1581
    assert count(100, stride=1, phases="all") == 1581


def test_max_chunks_is_an_even_and_repeatable_subset(tmp_path):
    angles = [write_angles(tmp_path / f"r{k}", y) for k, y in enumerate(truth()[:, :8000])]
    job = SplitChunksJob(**SMALL, by="time", max_chunks=ChunkLimits(train=30, test=None))
    split_chunks(angles, tmp_path / "a", job)
    split_chunks(angles, tmp_path / "b", job)
    report = json.loads((tmp_path / "a" / "splits.json").read_text())
    assert report["recordings"]["train"] == {"r0": 10, "r1": 10, "r2": 10}
    assert report["chunks"]["test"] > 30
    assert (tmp_path / "a" / "train.npz").read_bytes() == (tmp_path / "b" / "train.npz").read_bytes()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"min_chunks": 10**6}, "too few chunks for the train split"),
        ({"by": "speed"}, "by: found 'speed'"),
        ({"rate_hz": 150.0}, "multiple"),
        ({"stride": 0}, "stride: found 0"),
        ({"test_share": 0.5}, "sum to 1"),
        ({"phase": "all"}, "settings.phase: unknown key"),
    ],
)
def test_bad_settings(tmp_path, settings, message):
    angles = write_angles(tmp_path / "r0", truth()[0, :8000])
    with pytest.raises(InputError, match=message):
        split_chunks([angles], tmp_path / "data", SplitChunksJob.from_mapping(settings))
    assert not (tmp_path / "data").exists()


def test_too_few_chunks_in_a_split_names_it(tmp_path):
    y = truth()[0, :8000]
    angles = write_angles(tmp_path / "r0", y, gaps=[(0, 2400)])
    with pytest.raises(InputError, match="too few chunks for the test split"):
        split_chunks([angles], tmp_path / "data", SplitChunksJob(by="time", min_chunks=5))


def test_chunks_of_a_short_recording_lie_nearer_until_there_are_enough(tmp_path, caplog):
    """600 frames at 40 Hz, as another laboratory's series, by the settings that nobody wrote for it."""
    angles = write_angles(tmp_path / "r0", truth()[0, :6000:10], 40.0)
    settings = ChunkKeys().at(40.0, "split")
    split_chunks([angles], tmp_path / "data", settings)
    counts = json.loads((tmp_path / "data" / "splits.json").read_text())["chunks"]
    assert min(counts.values()) >= settings.min_chunks == 30
    assert "the test split's chunks begin every 4 points instead of every 8" in caplog.text
    assert "they overlap" in caplog.text and "train" not in caplog.text
    held = frames_of(tmp_path / "data", 1, settings.length)
    assert not held["validation"] & held["test"] and not held["train"] & (held["validation"] | held["test"])


def test_two_recordings_of_one_name_and_a_broken_table(tmp_path):
    angles = write_angles(tmp_path / "r0", truth()[0, :8000])
    with pytest.raises(InputError, match="different names"):
        split_chunks([angles, angles], tmp_path / "data", SplitChunksJob())
    angles.write_text("frame,t\n0,0\n")
    with pytest.raises(InputError, match="column theta1 is missing"):
        split_chunks([angles], tmp_path / "data", SplitChunksJob())


@pytest.mark.slow
def test_real_recordings_by_energy(tmp_path):
    angles = []
    for name, path in list(list_marker_files(real_recordings()).items())[:4]:
        import_markers(path, tmp_path / name / "markers.csv", ImportMarkersJob())
        measure_angles(*(tmp_path / name / f for f in ("markers.csv", "angles.csv", "angles.json")), MeasureAnglesJob())
        angles.append(tmp_path / name / "angles.csv")
    split_chunks(angles, tmp_path / "data", SplitChunksJob(phases="first", stride=20))
    frames = frames_of(tmp_path / "data")
    assert not frames["train"] & frames["test"]
    report = json.loads((tmp_path / "data" / "splits.json").read_text())
    counts = np.array([report["chunks"][name] for name in SPLITS])
    assert counts / counts.sum() == pytest.approx([0.4, 0.3, 0.3], abs=0.02)
    assert report["initial_speeds_p99"]["test"][1] > 1.5 * report["initial_speeds_p99"]["train"][1]


@pytest.mark.parametrize("by", others_slow(["energy", "time"]))
def test_long_chunks_lie_in_the_frames_of_their_split(tmp_path, by):
    angles = [write_angles(tmp_path / f"r{k}", y) for k, y in enumerate(truth())]
    settings = SplitChunksJob(**SMALL, by=by, horizons_s=[1.0, 2.0])
    split_chunks(angles, tmp_path / "data", settings)
    spans = frames_of(tmp_path / "data")
    for name in ("validation_1s", "test_2s"):
        output = tmp_path / f"{name}.npz"
        cut_horizon(angles, output, CutHorizonJob(split=settings, set=name))
        long, (split, end) = Trajectories.load(output), (name.split("_")[0], float(name[-2]))
        assert long.t[-1] == pytest.approx(end) and len(long.t) == 100 * end + 1
        assert 0 < len(long) <= 300
        others = set().union(*(frames for one, frames in spans.items() if one != split))
        for identity, y in zip(long.id, long.y, strict=True):
            recording, first = identity.split("/")
            rows = int(first) + 4 * np.arange(len(long.t))
            expected = truth()[int(recording[1:])][rows]
            turns = (expected[:, :2] - y[:, :2]) / (2 * np.pi)
            np.testing.assert_allclose(turns, np.broadcast_to(turns[0].round(), turns.shape), atol=1e-5)
            np.testing.assert_allclose(y[:, 2:], expected[:, 2:], rtol=1e-5, atol=1e-5)
            assert not {(recording, f) for f in range(rows[0], rows[-1] + 1)} & others


def test_recordings_too_short_for_a_horizon_are_refused_in_one_line(tmp_path):
    angles = [write_angles(tmp_path / "r0", truth()[0][:1600])]
    job = CutHorizonJob(split=SplitChunksJob(**SMALL, by="time", horizons_s=[2.0]), set="test_2s")
    with pytest.raises(InputError, match=r"no test chunk of 2 s: the longest stretch of its frames lasts 1\.2 s; give"):
        cut_horizon(angles, tmp_path / "test_2s.npz", job)


@pytest.mark.parametrize(
    ("horizons", "message"),
    [([0.1], "found 0.1; chunks end at 0.19 s already"), ([1.0, 1.0], "give each once"), ([0.0], "more than 0")],
)
def test_horizons_that_make_no_sense(tmp_path, horizons, message):
    with pytest.raises(InputError, match=message):
        split_chunks([tmp_path / "a.csv"], tmp_path / "data", SplitChunksJob.from_mapping({"horizons_s": horizons}))
