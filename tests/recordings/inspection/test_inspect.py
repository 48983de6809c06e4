"""What inspect proposes for videos of several looks tracks them, and is a valid configuration."""

import glob
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from drawn import ARMS, PAINT, PIVOT, RATE, SIZE, draw, markers_of, swinging, wall, write_video

from expertaug import cli
from expertaug.config import load as config
from expertaug.config import recording_settings
from expertaug.errors import InputError
from expertaug_recordings.inspection.inspect import inspect
from expertaug_recordings.markers.appearance import Appearance
from expertaug_recordings.markers.disks import hsv
from nightly import others_slow

ROOT = Path(__file__).parents[3]
FILES = [ROOT / "config" / "config.yaml"]
LOOKS = {
    "disks": ("disk", ("red", "green", "blue"), (205, 208, 212), True, 0.0),
    "a background of a marker's hue": ("disk", ("red", "orange", "yellow"), (60, 74, 84), False, 0.0),
    "quadrants": ("quadrant", ("yellow", "magenta", "cyan"), (4, 4, 4), True, 0.0),
    "camera on its side": ("disk", ("cyan", "magenta", "green"), (30, 30, 30), True, 90.0),
}


@pytest.fixture(scope="module")
def base():
    return config.validate(config.load(FILES))


@pytest.mark.parametrize("name", others_slow(LOOKS))
def test_the_proposal_is_valid_and_finds_the_markers(name, base, tmp_path, monkeypatch):
    style, names, background, marked, tilt = LOOKS[name]
    centres = markers_of(swinging(190, (1.2, 0.5, 0.0, 0.0))[::2, :2], (292.7, 124.2), (67.5, 45.0), tilt)
    frames = draw(
        centres, (480, 270), [PAINT[n] if marked or k else None for k, n in enumerate(names)], 18, style, background
    )
    video = write_video(frames, tmp_path / "clip.mp4", RATE / 2)
    text = inspect(video, tmp_path / "contact.png")
    block = yaml.safe_load(text)
    found = config.validate(config.merge(config.load(FILES), block))
    markers = block["recordings"]["tracking"]["markers"]
    assert markers["style"] == style
    look = Appearance.from_mapping(markers)
    for role, wanted in zip(("pivot", "joint", "tip"), names, strict=True):
        if markers[role] is not None:
            seen, true = getattr(look, role), hsv(np.array([PAINT[wanted]]) / 255)[0, 0]
            assert abs((seen.middle - true + 180) % 360 - 180) < seen.reach
    assert (look.pivot is None) == (not marked)
    assert block["recordings"]["angles"]["rotation_deg"] == pytest.approx(tilt, abs=0.5)
    assert recording_settings.track_markers(found).marker_diameter_px == pytest.approx(18, abs=0.5)
    assert recording_settings.split_chunks(found, "double_pendulum").rate_hz == pytest.approx(60)
    assert "left over" not in text
    assert "all found in 24 of 24" in text or "all found in 23 of 24" in text
    sheet = cv2.imread(str(tmp_path / "contact.png"))
    assert sheet.shape[0] > 500 and sheet.shape[1] > 1400
    assert np.ptp(sheet[60:].reshape(-1, 3), axis=0).min() > 150  # something is drawn on the frames


def refused(tmp_path, frames, message, **given):
    with pytest.raises(InputError, match=message) as error:
        inspect(write_video(frames, tmp_path / "clip.mp4", 100), tmp_path / "contact.png", **given)
    assert "\n" not in str(error.value)


def test_a_video_without_markers_is_refused(tmp_path):
    refused(
        tmp_path, np.stack([wall()] * 12), "no round coloured markers in 12 frames; .*contact.png shows what was seen"
    )
    assert (tmp_path / "contact.png").exists()


@pytest.mark.slow
def test_a_pendulum_at_rest_is_refused(tmp_path):
    centres = markers_of(np.zeros((12, 2)), PIVOT, ARMS)
    frames = draw(centres, SIZE, [PAINT[n] for n in ("red", "green", "blue")])
    refused(tmp_path, frames, r"round disks of hues near 0°, 120°, 220° in 12 of 12 frames, but no two .* swing")


@pytest.mark.slow
def test_markers_of_one_colour_are_refused(tmp_path):
    centres = markers_of(swinging(40)[:, :2], PIVOT, ARMS)
    refused(tmp_path, draw(centres, SIZE, [PAINT["red"]] * 3), r"hues near 0° in \d+ of \d+ frames, but no two")


def test_a_swing_too_short_to_find_its_pivot_names_the_key(tmp_path):
    theta = np.stack([0.12 * np.sin(0.4 * np.arange(16)), np.zeros(16)], axis=1)
    frames = draw(markers_of(theta, (160.2, 30.3), (140.0, 60.0)), (320, 240), [None, PAINT["blue"], None], 16)
    key = r"moves over \d+° only: too little to find the pivot .*set recordings.tracking.markers.pivot_px"
    refused(tmp_path, frames, key)


def test_a_sheet_must_be_a_picture(tmp_path):
    with pytest.raises(InputError, match=r"contact\.mp4: suffix '\.mp4'; a contact sheet is \.png or \.jpg"):
        inspect(tmp_path / "none.mp4", tmp_path / "contact.mp4")


@pytest.mark.slow
def test_a_name_can_neither_add_keys_nor_match_other_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    frames = draw(markers_of(swinging(60)[:, :2], PIVOT, ARMS), SIZE, [PAINT[n] for n in ("red", "green", "blue")])
    name = "[x]*\nresults: elsewhere\n#.mp4"
    write_video(frames, tmp_path / "plain.mp4", 100).rename(tmp_path / name)
    Path("x, another one.mp4").write_text("")
    proposed = yaml.safe_load(inspect(name, "contact.png"))
    assert list(proposed) == ["recordings"]
    assert glob.glob(proposed["recordings"]["videos"]["path"]) == [name]  # noqa: PTH207


def test_the_command_prints_yaml_and_refuses_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    centres = markers_of(swinging(24 * 13)[::24, :2], (170.2, 100.7), (52.0, 38.0))
    frames = draw(centres, (340, 208), [PAINT[n] for n in ("red", "green", "blue")], 16, background=(60, 58, 55))
    write_video(frames, tmp_path / "clip.mp4", 100)
    assert cli.main(["inspect-video", "clip.mp4"]) == 0
    block = yaml.safe_load(capsys.readouterr().out)
    assert block["recordings"]["videos"] == {"path": "clip.mp4"} and "experiments" not in block
    assert Path("contact.png").exists()
    assert cli.main(["inspect-video", "clip.mp4", "--rate", "100", "--from", "0.02", "--to", "0.11"]) == 0
    text, cut = capsys.readouterr().out, {"from_s": 0.02, "to_s": 0.11}
    assert yaml.safe_load(text)["recordings"]["videos"] == {"path": "clip.mp4", "rate_hz": 100} | cut
    assert "10 frames" in text
    assert cli.main(["inspect-video", "none.mp4"]) == 2
    assert capsys.readouterr().err == "expertaug inspect-video: none.mp4: no such file; give a video file\n"


@pytest.mark.slow
def test_a_camera_that_looks_askew_is_told_and_undone(tmp_path):
    """The picture is 6 % narrower than it should be, markers and all."""
    centres = markers_of(swinging(500)[:, :2], PIVOT, ARMS)
    frames = draw(centres, SIZE, [PAINT[n] for n in ("red", "green", "blue")])
    narrow = np.stack([cv2.resize(f, (602, 360), interpolation=cv2.INTER_AREA) for f in frames])
    text = inspect(write_video(narrow, tmp_path / "clip.mp4", RATE), tmp_path / "contact.png")
    block = yaml.safe_load(text)
    assert block["recordings"]["angles"] == {"rotation_deg": pytest.approx(0, abs=0.5), "rectify": {"ellipse": True}}
    assert re.search(
        r"# the camera looks askew, a circle is 1.06\d times as long as wide, narrowest along 90 deg", text
    )
    found = config.validate(config.merge(config.load(FILES), block))
    assert recording_settings.measure_angles(found, "clip").rectify.ellipse
    text = inspect(write_video(frames, tmp_path / "faced.mp4", RATE), tmp_path / "contact.png")
    assert "rectify" not in text


def clip(path, colours, launch=(1.2, 0.5, 0.0, 0.0), rate=60, diameter=24, tilt=0.0, count=150):
    """A small clip at a rate, in true time."""
    centres = markers_of(swinging(240 // rate * count, launch)[:: 240 // rate, :2], PIVOT, ARMS, tilt)
    return write_video(draw(centres, SIZE, [PAINT[n] for n in colours], diameter), path, rate)


@pytest.mark.slow
def test_many_videos_share_one_configuration_with_what_differs_by_file(tmp_path):
    clip(tmp_path / "one.mp4", ("red", "green", "blue"))
    clip(tmp_path / "two.mp4", ("red", "green", "blue"), (0.9, 0.8, 0.0, 0.0), rate=120)
    clip(tmp_path / "other.mp4", ("cyan", "magenta", "yellow"), tilt=90.0)
    write_video(np.stack([wall()] * 12), tmp_path / "empty.mp4", 60)
    files = [tmp_path / f"{name}.mp4" for name in ("one", "empty", "two", "other")]
    text = inspect(files, tmp_path / "contact.png")
    block = yaml.safe_load(text)
    recordings = block["recordings"]
    assert list(block) == ["recordings"] and recordings["analysis_rate_hz"] == 60
    assert [Path(p).stem for p in recordings["videos"]["path"]] == ["one", "two", "other"]
    assert recordings["tracking"]["markers"] == {"style": "disk", "pivot": "red", "joint": "green", "tip": "blue"}
    own = recordings["by_recording"]
    assert list(own) == ["other"] and own["other"]["angles"] == {"rotation_deg": 90}
    assert own["other"]["tracking"]["markers"]["joint"] == "magenta"
    assert "# left out: " in text and "no round coloured markers" in text
    found = config.validate(config.merge(config.load(FILES), block))
    assert recording_settings.track_markers(found, "two") == recording_settings.track_markers(found)
    assert recording_settings.track_markers(found, "other").markers.tip == "yellow"
    assert recording_settings.measure_angles(found, "other").rotation_deg == 90
    assert recording_settings.measure_angles(found, "one").rotation_deg == 0
    sheet = cv2.imread(str(tmp_path / "contact.png"))
    assert sheet.shape[0] > 4 * 150  # a row of each


@pytest.mark.parametrize(
    ("own", "message"),
    [
        (
            "{twp: {angles: {rotation_deg: 3}}}",
            "recordings.by_recording.twp: 'twp' is no recording; did you mean 'two'",
        ),
        ("{two: {angles: {rotation: 3}}}", "recordings.by_recording.two.angles.rotation: unknown key"),
        ("{two: {videos: {path: x}}}", "recordings.by_recording.two.videos.path: is of all recordings"),
        ("{two: {tracking: {markers: {joint: mauve}}}}", "mauve"),
        (
            "{two: {angles: {rectify: {checkerboard: none.png}}}}",
            "recordings.by_recording.two.angles.rectify.checkerboard: 'none.png' does not exist",
        ),
        ("{two: {arms_m: [1, 2]}}", "recordings.by_recording.two.arms_m: unknown key"),
    ],
)
def test_what_differs_is_checked(tmp_path, own, message):
    (tmp_path / "two.mp4").write_text("")
    block = f"run: [double_pendulum]\nrecordings: {{source: videos, videos: {{path: {tmp_path}}}, by_recording: {own}}}"
    (tmp_path / "my.yaml").write_text(block)
    with pytest.raises(InputError, match=re.escape(message)):
        config.validate(config.load([*FILES, tmp_path / "my.yaml"]))
