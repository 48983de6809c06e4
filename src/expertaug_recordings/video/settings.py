"""Settings of taking frames from a video."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from expertaug.settings import LIST, ONE, Count, NotNegative, Positive, Settings, by_shape, key

Size = Annotated[int, Field(ge=16, le=2**16)]
SizePair = Annotated[tuple[Size, Size], Field(strict=False)]


class TimeKeys(Settings):
    """When frames were taken, and which of them are used."""

    times: str | None = key(
        None,
        "for a folder of pictures: the name of a CSV in it with the columns file and t; names = the last number in "
        "each file's name; null = evenly spaced, at rate_hz",
    )
    time_unit_s: Positive = key(1.0, "length of one unit of these times: 0.001 for milliseconds", "s")
    from_s: NotNegative = key(0.0, "time, as a player shows it, from which frames are used", "s")
    to_s: Positive | None = key(
        None, "time up to which frames are used; later frames are not even read; null = all", "s"
    )


class ExtractSettings(TimeKeys):
    """How frames are taken from a video."""

    WHERE: ClassVar[str] = "recordings"

    analysis_rate_hz: Positive | None = key(
        None, "frames per second that are analysed, at most the video's; null = all", "Hz"
    )
    rate_hz: Positive | None = key(
        None, "frame rate at which the video was taken; null = the one in its metadata", "Hz"
    )
    rate_provenance: str | None = key(None, "where that rate is known from")
    expected_frames: Count | None = key(None, "frames that the video must have; null = as many as its metadata says")
    image_size_px: Annotated[Annotated[Size, ONE] | Annotated[SizePair, LIST], by_shape] | None = key(
        None, "side of a square image, or width and height, that the video must have; null = any", "px"
    )
