"""Videos in other containers, and frames of noise to put into them."""

from __future__ import annotations

import av
import numpy as np


def remux(source, target, format=None, pts=None):
    """Copy the packets into another container, with other timestamps if a function of them is given."""
    with av.open(str(source)) as given, av.open(str(target), "w", format=format) as made:
        stream = made.add_stream_from_template(given.streams.video[0])
        for packet in given.demux(video=0):
            if packet.dts is None:
                continue
            if pts is not None:
                packet.pts, packet.dts = pts(packet.pts), pts(packet.dts)
            packet.stream = stream
            made.mux(packet)
    return target


def drawn(count=60):
    rng = np.random.default_rng(0)
    for _ in range(count):
        yield rng.integers(0, 256, (64, 64, 3), dtype=np.uint8)
