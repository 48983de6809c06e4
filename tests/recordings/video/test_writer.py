"""What is written as video is read back: as many frames, at their rate, as they were."""

from __future__ import annotations

import av
import numpy as np
import pytest

from expertaug_recordings.video.writer import encode

FRAMES = [np.full((48, 64, 3), 40 * k, np.uint8) for k in range(6)]


@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_frames_come_back_as_they_were_at_their_rate(tmp_path, suffix):
    path = tmp_path / f"clip.{suffix}"
    encode(path, iter(FRAMES), (64, 48), 29.97, crf=0)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        seen = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
        assert float(stream.average_rate) == pytest.approx(29.97, rel=1e-3)
    assert np.abs(np.array(seen, int) - np.array(FRAMES, int)).max() <= 2


def test_the_same_frames_give_the_same_bytes(tmp_path):
    for name in ("a.mp4", "b.mp4"):
        encode(tmp_path / name, iter(FRAMES), (64, 48), 30.0)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
    encode(tmp_path / "c.mp4", iter(FRAMES), (64, 48), 30.0, flags="+faststart")
    data = (tmp_path / "c.mp4").read_bytes()
    assert 0 < data.find(b"moov") < data.find(b"mdat")
