"""Settings of measuring angles and of calibrating the expert."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from expertaug.recordings.corrections import Correction
from expertaug.settings import MANY, NotNegative, Positive, Settings, Share, key

Corners = Annotated[int, Field(ge=3, le=100)]


class RectifyKeys(Settings):
    """From the image to the plane of motion, before angles are measured."""

    ellipse: bool = key(
        False,
        "whether the view is told by the arms themselves, which are equally long in every direction; expertaug inspect "
        "proposes it where it helps",
    )
    checkerboard: str | None = key(
        None,
        "a picture of a checkerboard taken as the video was, or a folder of them; the first shows it in the plane of "
        "motion or parallel to it, but with ellipse, where only the lens is told by them",
    )
    corners: Annotated[tuple[Corners, Corners], Field(strict=False)] = key(
        (9, 6), "inner corners of the board, across and down"
    )


class AngleKeys(Settings):
    """From marker positions to arm angles."""

    WHERE: ClassVar[str] = "angles settings"

    max_gap_frames: int = key(8, "longest run of unusable frames that is interpolated", ge=0, le=MANY)
    max_speed: Positive = key(80.0, "fastest rotation to expect; longer gaps could hide a whole turn", "rad/s")
    arm_tolerance: Share | None = key(
        None,
        "a frame with an arm off its median length by more than this share is unusable; null = eight standard "
        "deviations of the recording's own lengths",
    )
    model_offsets: bool = key(
        True,
        "markers off their hinges, or in planes of different distance, are modelled where the arms' lengths tell of it",
    )
    pivot_tolerance: Share = key(
        0.05, "pivot markers off their median by more than this share of the first arm are not the pivot"
    )
    pivot_window_s: NotNegative | None = key(
        None,
        "time over which the pivot is averaged; 0 = each frame's own; null = what makes the first arm's length the "
        "steadiest, so that a shaking camera is followed and a pivot at rest is not",
        "s",
    )
    rotation_deg: float = key(
        0.0, "where gravity points in the image; 0 down, 90 right, -90 left, 180 up", "deg", ge=-360, le=360
    )
    rectify: RectifyKeys = key(RectifyKeys, "lens and oblique view, undone before angles are measured")
    smoothing_window_s: Positive | None = key(
        None,
        "window of the local polynomial that gives angles and speeds; null = for each frame as long as helps, by the "
        "markers' own noise, from none to .08 s",
        "s",
    )
    smoothing_order: int = key(5, "its order", ge=1, le=9)
    outlier_sigmas: Positive = key(
        12.0, "an angle further from the polynomial than this many standard deviations of the noise is unusable"
    )
    outlier_floor_deg: NotNegative = key(0.5, "unless it is nearer than this", "deg")
    min_usable_s: Positive = key(0.5, "a recording with less usable time is refused", "s")


class AngleSettings(AngleKeys):
    """The same with what the workflow knows of the recordings."""

    arm1_m: Positive | None = key(0.091, "length of the first arm, for the implied frame rate; null = not known", "m")
    rate_provenance: str = key("not stated", "where the frame rate comes from")
    rate_hz: Positive | None = key(None, "frames per second to which others are resampled; null = the file's", "Hz")
    span_s: Annotated[tuple[float, float | None], Field(strict=False)] | None = key(
        None, "first and last second that are used of a longer one; null = its end", "s"
    )
    single: bool = key(False, "whether it is a single pendulum, without a tip")
    corrections: list[Correction] = key(list, "markers that were placed by hand")


class CalibrationKeys(Settings):
    """How the constants of the compound expert are fitted."""

    WHERE: ClassVar[str] = "calibration settings"

    step_s: Annotated[float, Field(gt=0)] = key(
        0.005, "longest Runge-Kutta step of the forecasts that judge the fits", "s"
    )


class CalibrationSettings(CalibrationKeys):
    """The same with what the workflow knows of the recordings."""

    arm1_m: Positive | None = key(0.091, "length of the first arm, for the implied frame rate; null = not known", "m")
    arm2_m: Positive | None = key(0.070, "length of the second arm; null = not known", "m")
    nominal_rate_hz: Positive | None = key(
        400.0, "frame rate by which the data's times were made; null = they were not made by one", "Hz"
    )
    rate_provenance: str = key("nominal rate of the dataset", "where that rate comes from")
