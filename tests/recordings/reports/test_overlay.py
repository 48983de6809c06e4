"""Overlays play in a browser, show what was measured where it was measured, and draw forecasts."""

import av
import cv2
import numpy as np
import pandas as pd
import pytest
from angle_files import summary
from drawn import ARMS, PAINT, PIVOT, RATE, SIZE, draw, markers_of, swinging, write_video

from expertaug.errors import InputError
from expertaug_recordings.reports.overlay import GHOSTS, Forecast, Painter, _read, note, read_forecasts
from expertaug_recordings.reports.overlay import run_stage as overlay
from expertaug_recordings.settings import OverlayJob

COUNT, MARKERS = 200, ("pivot_x", "pivot_y", "joint_x", "joint_y", "tip_x", "tip_y")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A folder with a video and its measurement, of which frames 60 to 80 are unusable and 100 to 103 filled."""
    folder = tmp_path_factory.mktemp("overlay") / "r0"
    folder.mkdir()
    y = swinging(COUNT)
    centres = markers_of(y[:, :2], PIVOT, ARMS)
    write_video(draw(centres, SIZE, [PAINT[n] for n in ("red", "green", "blue")]), folder / "video.mp4", RATE)
    table = pd.DataFrame({"frame": np.arange(COUNT), "t": np.arange(COUNT) / RATE})
    quality, reason = np.ones(COUNT), np.full(COUNT, "", object)
    quality[60:80], reason[60:80] = 0, "lost:blue"
    quality[100:104], reason[100:104] = 0.5, "interpolated"
    centres[60:80, 2] = np.nan
    places = dict(zip(MARKERS, centres.reshape(COUNT, 6).T, strict=True))
    table.assign(**places, quality=quality, reason=reason).to_csv(folder / "markers.csv", index=False)
    theta = np.where(quality[:, None] > 0, y, np.nan)
    states = dict(zip(("theta1", "theta2", "omega1", "omega2"), theta.T, strict=True))
    table.assign(**states, energy=1.0, quality=quality, reason=reason, source=table["frame"]).to_csv(
        folder / "angles.csv", index=False
    )
    summary("r0", COUNT, RATE, ARMS, PIVOT).save(folder / "angles.json")
    return folder


def files_of(folder):
    return [folder / name for name in ("video.mp4", "markers.csv", "angles.csv", "angles.json")]


def run(folder, output, job, forecasts=None):
    overlay(*files_of(folder), output, job, forecasts)
    with av.open(str(output)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
        return stream.codec_context, float(stream.average_rate), np.stack(frames)


@pytest.mark.slow
def test_it_plays_in_a_browser(recording, tmp_path):
    codec, rate, frames = run(recording, tmp_path / "overlay.mp4", OverlayJob(speed=0.5, fps=30))
    assert (codec.name, codec.pix_fmt, codec.profile) == ("h264", "yuv420p", "High")
    data = (tmp_path / "overlay.mp4").read_bytes()
    assert 0 < data.find(b"moov") < data.find(b"mdat")  # the index comes first
    assert rate == pytest.approx(30) and len(frames) == 50
    assert frames.shape[1] % 2 == frames.shape[2] % 2 == 0 and frames.shape[1] > 480


def test_a_part_of_the_recording(recording, tmp_path):
    part = OverlayJob(start_s=0.25, duration_s=0.25, speed=1.0, fps=60)
    _, rate, frames = run(recording, tmp_path / "o.mp4", part)
    assert rate == pytest.approx(60) and len(frames) == 15
    with pytest.raises(InputError, match=r"overlay\.start_s: 9 s is after its end at 0\.83 s"):
        run(recording, tmp_path / "o.mp4", OverlayJob(start_s=9.0))
    assert [p.name for p in tmp_path.iterdir()] == ["o.mp4"]


def test_markers_are_ringed_where_measured_alone(recording):
    seen = _read(*files_of(recording)[1:])
    painter = Painter(seen, [], SIZE)
    black = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)

    def drawn(row):
        """Light of the pendulum alone: below the lines of text, above the panel."""
        return painter.paint(black, row)[70 : painter.frame_size[1]].astype(int)

    assert drawn(10).sum() > 2 * drawn(101).sum() > 0  # arms alone, from the angles
    assert (drawn(101)[..., 0] < 60).all()  # in orange
    assert drawn(70).sum() == 0
    ringed = drawn(10)
    x, y = seen.place[10, 0] * painter.factor - (0, 70)
    around = ringed[int(y - 12) : int(y + 12), int(x - 12) : int(x + 12)].max(axis=2)
    assert (around > 60).sum() > 30


def test_an_arm_from_the_angles_lies_on_the_markers(recording):
    seen = _read(*files_of(recording)[1:])
    painter = Painter(seen, [], SIZE)
    for row in (0, 90, 150):
        assert painter.places(seen.theta[row]) == pytest.approx(seen.place[row], abs=0.1)


def forecast_file(folder, recording, first, off=0.3, names=("theta1", "theta2", "omega1", "omega2"), **change):
    """A file of forecasts of two chunks that start alike: of r0 at frame ``first`` and of another recording."""
    y = pd.read_csv(recording / "angles.csv")[["theta1", "theta2", "omega1", "omega2"]].to_numpy()
    truth = np.stack([y[first + 3 * np.arange(10)]] * 2)
    texts = {"state_units": ["rad"] * 4, "parameter_names": ["a"], "parameter_units": [""], "state_names": list(names)}
    arrays = {
        "t": np.arange(10) * 3 / RATE,
        "observed": np.array(5),
        "seeds": np.array([0]),
        "test_index": np.arange(2),
        "test_truth": truth + 2 * np.pi,
        "test_prediction": truth[None] + off * np.linspace(0, 1, 10)[:, None],
        "test_z_e": np.zeros((2, 1)),
        "test_id": np.array(["r1/120", f"r0/{first}"]),
        **{name: np.array(text) for name, text in texts.items()},
        **change,
    }
    np.savez(folder / "forecasts.npz", **{name: array for name, array in arrays.items() if array is not None})
    return {"X+": folder / "forecasts.npz"}


def test_forecasts_are_placed_by_the_chunk_that_they_carry(recording, tmp_path):
    files, frame = forecast_file(tmp_path, recording, 120), np.arange(COUNT)
    (found,) = read_forecasts(files, "r0", frame, RATE)
    assert (found.label, found.rows.tolist()) == ("X+", list(range(120, 148, 3)))
    truth = pd.read_csv(recording / "angles.csv")[["theta1", "theta2"]].to_numpy()
    off = np.angle(np.exp(1j * (found.at(147) - truth[147])))
    assert off == pytest.approx([0.3, 0.3], abs=1e-6)
    (found,) = read_forecasts(files, "r0", frame + 20, RATE)  # a recording whose first frame is number 20
    assert found.rows[0] == 100
    assert [f.rows[0] for f in read_forecasts(files, "r1", frame, RATE)] == [120]
    assert read_forecasts(files, "r2", frame, RATE) == []
    files = forecast_file(tmp_path, recording, 120, names=("a", "b", "c", "d"))
    assert read_forecasts(files, "r0", frame, RATE) == []


def test_forecasts_that_cannot_be_placed_are_refused(recording, tmp_path):
    frame = np.arange(COUNT)
    with pytest.raises(InputError, match="not a forecast file"):
        read_forecasts({"X": recording / "angles.csv"}, "r0", frame, RATE)
    for change, message in (
        ({"test_id": None}, "does not say of which chunks its test forecasts are; run evaluate again"),
        ({"test_id": np.array(["r0/999", "r0/120"])}, "forecasts 'r0/999' over 28 frames; r0 has no such frames"),
        ({"test_id": np.array(["r0/x", "r0/120"])}, "forecasts 'r0/x' over"),
        ({"test_id": np.array(["r0/180", "r0/120"])}, "forecasts 'r0/180' over"),
        ({"test_id": np.array(["r0/120"])}, r"test_id \(1,\) of type <U6; identities are \(2,\), texts"),
        ({"test_id": np.array([1, 2])}, r"identities are \(2,\), texts"),
    ):
        with pytest.raises(InputError, match=message):
            read_forecasts(forecast_file(tmp_path, recording, 120, **change), "r0", frame, RATE)


@pytest.mark.slow
def test_a_forecast_is_shown_held_and_outside_of_the_chosen_part(recording, tmp_path):
    files = forecast_file(tmp_path, recording, 120, off=1.0)
    job = OverlayJob(duration_s=0.05, speed=1.0, fps=60)
    _, _, plain = run(recording, tmp_path / "a.mp4", job)
    _, _, frames = run(recording, tmp_path / "b.mp4", job, files)
    assert len(plain) == 3 and len(frames) > 3 + 10 + 60  # held for a second
    colour = np.array(GHOSTS[0])
    near = [(np.abs(frame[70:400].astype(int) - colour).max(axis=2) < 60).sum() for frame in frames]
    assert near[0] == 0 and max(near) > 20


def test_a_ghost_swings_where_the_forecast_says(recording):
    seen = _read(*files_of(recording)[1:])
    one = Forecast("X", np.array([10, 20]), np.array([[0.0, 0.0], [0.0, np.pi]]))
    painter = Painter(seen, [one], SIZE)
    image = painter.paint(np.zeros((SIZE[1], SIZE[0], 3), np.uint8), 10)
    x, y = PIVOT[0] * painter.factor, (PIVOT[1] + sum(ARMS)) * painter.factor
    ring = image[int(y - painter.radius - 3) : int(y + painter.radius + 3), int(x - 20) : int(x + 20)].astype(int)
    assert (np.abs(ring - np.array(GHOSTS[0])).max(axis=2) < 80).sum() > 20


def test_files_that_do_not_fit_are_refused(recording, tmp_path):
    files = files_of(recording)
    with pytest.raises(InputError, match=r"o\.webm: suffix '\.webm'; an overlay is \.mp4"):
        overlay(*files, tmp_path / "o.webm", OverlayJob())
    with pytest.raises(InputError, match=r"video\.mp4: 200 frames at 100 Hz; .*markers\.csv has 200 at 240 Hz"):
        overlay(*files, tmp_path / "o.mp4", OverlayJob(rate_hz=100.0))
    pd.read_csv(files[1])[:50].to_csv(tmp_path / "markers.csv", index=False)
    with pytest.raises(InputError, match=r"50 frames, .*angles\.csv has 200, .*angles\.json has 200"):
        overlay(files[0], tmp_path / "markers.csv", *files[2:], tmp_path / "o.mp4", OverlayJob())
    for text, message in (("{}", "recording: Field required"), ("[1]", "JSON: Input should be an object")):
        (tmp_path / "angles.json").write_text(text)
        with pytest.raises(InputError, match=rf"angles\.json: {message}; run measure_angles again"):
            overlay(*files[:3], tmp_path / "angles.json", tmp_path / "o.mp4", OverlayJob())
    table = pd.read_csv(files[2], keep_default_na=False)
    table["quality"] = 0.7
    table.to_csv(tmp_path / "angles.csv", index=False)
    with pytest.raises(InputError, match=r"a frame without a quality of 0, \.5 or 1"):
        overlay(*files[:2], tmp_path / "angles.csv", files[3], tmp_path / "o.mp4", OverlayJob())
    assert not (tmp_path / "o.mp4").exists()


def test_a_recording_that_was_left_out_says_so(tmp_path):
    note("left out: clip.mp4: is empty (0 bytes); copy the recording again", tmp_path / "o.mp4")
    frame = cv2.VideoCapture(str(tmp_path / "o.mp4")).read()[1]
    assert frame.shape == (120, 960, 3) and frame.max() > 200
