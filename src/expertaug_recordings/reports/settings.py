"""Settings of drawing over a recording's video."""

from __future__ import annotations

from typing import ClassVar

from expertaug.settings import NotNegative, Positive, Settings, key
from expertaug_recordings.video.settings import TimeKeys


class OverlayView(Settings):
    """What is shown of a recording."""

    WHERE: ClassVar[str] = "overlay settings"

    fps: float = key(25.0, "maximum frame rate of the overlay", "Hz", gt=0, le=240)
    speed: Positive = key(0.25, "speed of the overlay; 1 = that of the recording")
    start_s: NotNegative = key(0.0, "time in the recording at which the overlay starts", "s")
    duration_s: Positive | None = key(
        10.0, "how much of the recording the overlay shows; null = all; parts with forecasts are always shown", "s"
    )


class OverlaySettings(OverlayView, TimeKeys):
    """The same with the video's rate and times, as for extracting its frames."""

    rate_hz: Positive | None = key(None, "frame rate of the video; null = the one in its metadata", "Hz")
    rate_provenance: str | None = key(None, "where that rate is known from")

    @property
    def of_frames(self) -> dict[str, object]:
        """What opening the video takes (:func:`expertaug_recordings.video.source.open_frames`)."""
        return self.model_dump(include={"rate_hz", "rate_provenance", *TimeKeys.model_fields})


class OverlayKeys(OverlayView):
    """Videos with markers, arms, angles and forecasts drawn over the frames (the target overlay makes them)."""

    experiment: str | None = key(
        None,
        "experiment from which forecasts, if there are any, are drawn; null = the run's first experiment on recordings",
    )
    variants: list[str] | None = key(
        None, "methods for which forecasts are drawn, with a + for augmented versions; null = the experiment's last"
    )
