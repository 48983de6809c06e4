"""Videos whose headers lie, whose frames are missing or late, and files that are no videos."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import av

from damaged.base import EITHER, FRAMES, REFUSED, Case

FINE = 64  # parts of a container's unit of time
ALIEN = {  # what is called .mp4 and is none: playlists that name other files, pages, pictures' headers
    "playlist": b"#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nfile:///etc/passwd\n#EXT-X-ENDLIST\n",
    "concatenation": b"ffconcat version 1.0\nfile base.mp4\nfile base.mp4\n",
    "session": b"v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video 5004 RTP/AVP 96\n",
    "subtitles": b"1\n00:00:00,000 --> 00:00:01,000\nhello\n",
    "page": b"<!DOCTYPE html><html><body>404 Not Found</body></html>",
    "nothing": b"",
    "one byte": b"\0",
    "zeros": bytes(5000),
    "gif": b"GIF89a\xff\xff\xff\xff\x80\0\0\0\0\0\xff\xff\xff,\0\0\0\0\xff\xff\xff\xff\0\x02\x02D\x01\0;",
    "bitmap": b"BM" + struct.pack("<IHHIIiiHHIIiiII", 54, 0, 0, 54, 40, 2**30, 2**30, 1, 24, 0, 0, 0, 0, 0, 0),
}


def videos(bases: dict[str, Case]) -> Iterator[Case]:
    for name, data in ALIEN.items():
        yield Case(f"alien: {name}", "video", "", ".mp4", data)
    for name in ("csv", "tar", "zip"):
        yield Case(f"alien: {name} called mp4", "video", "", ".mp4", bases[name].data)
    yield from _metadata(bases)
    yield from _packets(bases)


def boxes(data: bytes, start: int = 0, end: int | None = None) -> Iterator[tuple[int, bytes]]:
    """Offsets and types of an MP4's boxes, also those within boxes; nothing for other files."""
    end = len(data) if end is None else end
    while start + 8 <= end:
        size, kind = struct.unpack(">I4s", data[start : start + 8])
        if size < 8 or start + size > end or not kind.isalnum():
            return
        yield start, kind
        if kind in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"moof", b"traf"):
            yield from boxes(data, start + 8, start + size)
        start += size


def patched(data: bytes, kind: bytes, offset: int, value: bytes) -> bytes:
    """An MP4 with ``value`` at an offset into each box of a kind."""
    changed = bytearray(data)
    for at, found in boxes(data):
        if found == kind:
            changed[at + offset : at + offset + len(value)] = value
    return bytes(changed)


def _metadata(bases: dict[str, Case]) -> Iterator[Case]:
    """Wrong numbers in headers: rate, count, dimensions, offsets."""
    mp4, avi = bases["mp4"].data, bases["mjpeg"].data
    big = struct.pack(">I", 2**31 - 1)
    edits = {
        "time scale of zero": (b"mdhd", 20, bytes(4), REFUSED),
        "huge time scale": (b"mdhd", 20, big, REFUSED),
        "time scale of one": (b"mdhd", 20, struct.pack(">I", 1), REFUSED),
        "step of zero": (b"stts", 20, bytes(4), REFUSED),
        "huge step": (b"stts", 20, big, REFUSED),
        "steps for fewer frames": (b"stts", 16, struct.pack(">I", FRAMES - 5), REFUSED),
        "steps for more frames": (b"stts", 16, struct.pack(">I", FRAMES + 5), EITHER),
        "no frames": (b"stsz", 16, bytes(4), REFUSED),
        "fewer frames": (b"stsz", 16, struct.pack(">I", FRAMES - 5), REFUSED),
        "more frames": (b"stsz", 16, struct.pack(">I", FRAMES + 5), EITHER),
        "frames without end": (b"stsz", 16, big, EITHER),
        "frames of one size": (b"stsz", 12, struct.pack(">I", 1000), REFUSED),
        "chunks elsewhere": (b"stco", 16, big, REFUSED),
        "65535 px square": (b"tkhd", 84, struct.pack(">II", 65535 << 16, 65535 << 16), EITHER),
        "65535 px square in the sample's entry": (b"stsd", 48, struct.pack(">HH", 65535, 65535), EITHER),
        "0 px": (b"stsd", 48, bytes(4), EITHER),
        "another codec": (b"stsd", 20, b"hvc1", REFUSED),
        "no codec": (b"stsd", 20, b"xxxx", EITHER),
    }
    for name, (kind, offset, value, expected) in edits.items():
        yield Case(f"metadata: {name}", "video", "mp4", ".mp4", patched(mp4, kind, offset, value), expected)
    frame_header = avi.index(b"\xff\xc0")  # of JPEG: marker, length, precision, height, width
    for name, side in (("0", 0), ("1", 1), ("65535", 65535)):
        every = avi.replace(
            avi[frame_header : frame_header + 9], avi[frame_header : frame_header + 5] + struct.pack(">HH", side, side)
        )
        yield Case(f"metadata: JPEG of {name} px", "video", "mjpeg", ".avi", every)
        last = avi.rindex(b"\xff\xc0")
        one = avi[: last + 5] + struct.pack(">HH", side, side) + avi[last + 9 :]
        # A smaller one is scaled to the size of the others without a word.
        expected = EITHER if side == 1 else REFUSED
        yield Case(f"metadata: one JPEG of {name} px", "video", "mjpeg", ".avi", one, expected)
    main, stream = avi.index(b"avih") + 8, avi.index(b"strh") + 8
    for name, at, value in (
        ("AVI of no frames", (main + 16, stream + 32), 0),
        ("AVI of fewer frames", (main + 16, stream + 32), FRAMES - 5),
        ("AVI of more frames", (main + 16, stream + 32), FRAMES + 5),
        ("AVI at 1/s", (stream + 24,), 1),
        ("AVI at 0/s", (stream + 24,), 0),
        ("AVI of 0 scale", (stream + 20,), 0),
        ("AVI of 2^31 px", (main + 32, main + 36), 2**31 - 1),
    ):
        changed = bytearray(avi)
        for offset in at:
            changed[offset : offset + 4] = struct.pack("<I", value)
        yield Case(f"metadata: {name}", "video", "mjpeg", ".avi", bytes(changed), EITHER)
    yield Case("metadata: stream of 65520 px square", "video", "", ".h264", _vast_stream())


def _packets(bases: dict[str, Case]) -> Iterator[Case]:
    """Whole frames missing, twice, late or exchanged, in containers that are sound."""
    # An AVI has no times to be wrong, and those of a Matroska file are rounded.
    for base, suffix in (("mp4", ".mp4"), ("mp4", ".mkv"), ("mjpeg", ".mov")):
        for name, change in (
            ("frame missing", lambda k: None if k == 9 else (k, k)),
            ("five frames missing", lambda k: None if 9 <= k < 14 else (k, k)),
            ("frame missing, times closed up", lambda k: None if k == 9 else (k, k - (k > 9))),
            ("late frame", lambda k: (k, k + (0.7 if k == 9 else 0))),
            ("jump in time", lambda k: (k, k + 3 * (k > 9))),
            ("time runs slower", lambda k: (k, k * (1 + 0.02 * k))),
            ("frames exchanged", lambda k: ({9: 13, 13: 9}.get(k, k), k)),
        ):
            data = _rearranged(bases[base], change, suffix)
            # Nothing tells of frames that are exchanged, or missing without a trace, where none builds on them.
            traceless = "closed up" in name or (base == "mjpeg" and "exchanged" in name)
            expected = EITHER if traceless else REFUSED
            yield Case(f"packets: {name} in {base}{suffix}", "video", base, suffix, data, expected)


def _rearranged(base: Case, change: Callable[[int], tuple[int, float] | None], suffix: str) -> bytes:
    """The video with its packets moved: ``change`` gives of each place the packet and the time, in frames."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / f"a{base.suffix}", Path(folder) / f"b{suffix}"
        source.write_bytes(base.data)
        with av.open(str(source)) as given, av.open(str(target), "w", options={"fflags": "+bitexact"}) as made:
            template = given.streams.video[0]
            stream = made.add_stream_from_template(template)
            packets = [p for p in given.demux(video=0) if p.dts is not None]
            content = [bytes(p) for p in packets]
            step = float(1 / (template.average_rate * template.time_base))
            for k, old in enumerate(packets):
                place = change(k)
                if place is None:
                    continue
                shift = round((place[1] - k) * step * FINE)
                packet = av.Packet(content[place[0]])
                packet.pts, packet.dts = old.pts * FINE + shift, old.dts * FINE + shift
                packet.time_base, packet.stream = template.time_base / FINE, stream
                packet.is_keyframe = old.is_keyframe
                made.mux(packet)
        return target.read_bytes()


def _vast_stream() -> bytes:
    """A bare H.264 stream whose parameter set declares 65520 × 65520 px."""

    def golomb(value: int) -> str:
        bits = f"{value + 1:b}"
        return "0" * (len(bits) - 1) + bits

    side = 65520 // 16 - 1
    # baseline, level 6.2, one reference, size in macroblocks, frames only, no cropping
    bits = "".join(map(golomb, (0, 0, 2, 1))) + "0" + golomb(side) + golomb(side) + "11000" + "1"
    bits += "0" * (-len(bits) % 8)
    parameters = bytes([0x67, 66, 0, 62]) + int(bits, 2).to_bytes(len(bits) // 8, "big")
    picture = bytes.fromhex("68ce3880") + b"\0\0\0\1" + bytes.fromhex("65888404") + bytes(range(1, 200))
    return (b"\0\0\0\1" + parameters + b"\0\0\0\1" + picture) * 5
