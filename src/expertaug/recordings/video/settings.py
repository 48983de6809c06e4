"""Settings of taking frames from a video."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from expertaug.settings import LIST, ONE, Count, Positive, Settings, by_shape, key

Size = Annotated[int, Field(ge=16, le=2**16)]
SizePair = Annotated[tuple[Size, Size], Field(strict=False)]


class ExtractSettings(Settings):
    """How frames are taken from a video."""

    WHERE: ClassVar[str] = "recordings"

    analysis_rate_hz: Positive | None = key(
        None, "frames kept per second, which must divide the video's rate evenly; null = all", "Hz"
    )
    rate_hz: Positive | None = key(
        None, "frame rate at which the video was taken; null = the one in its metadata", "Hz"
    )
    rate_provenance: str | None = key(None, "where that rate is known from")
    expected_frames: Count | None = key(None, "frames that the video must have; null = as many as its metadata says")
    image_size_px: Annotated[Annotated[Size, ONE] | Annotated[SizePair, LIST], by_shape] | None = key(
        None, "side of a square image, or width and height, that the video must have; null = any", "px"
    )
