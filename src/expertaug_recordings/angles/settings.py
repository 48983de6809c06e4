"""Settings of measuring angles and of calibrating the expert."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from expertaug.settings import MANY, NotNegative, Positive, Settings, Share, key
from expertaug_recordings.corrections import Correction

Corners = Annotated[int, Field(ge=3, le=100)]


class RectifyKeys(Settings):
    """From the image to the plane of motion, before angles are measured."""

    ellipse: bool = key(
        False,
        "whether the view is found from the arms themselves, which are equally long in every direction; expertaug "
        "inspect proposes it where it helps",
    )
    checkerboard: str | None = key(
        None,
        "a picture of a checkerboard, taken in the same way as the video, or a folder of such pictures; the first "
        "shows the board in the plane of motion or parallel to it, except with ellipse, where the pictures determine "
        "only the lens",
    )
    corners: Annotated[tuple[Corners, Corners], Field(strict=False)] = key(
        (9, 6), "number of inner corners of the board, across and down"
    )


class AngleKeys(Settings):
    """From marker positions to arm angles."""

    WHERE: ClassVar[str] = "angles settings"

    max_gap_frames: int = key(8, "longest run of unusable frames that is interpolated", ge=0, le=MANY)
    max_speed: Positive = key(
        80.0,
        "fastest rotation to expect; it limits the gaps that are interpolated, since longer ones could hide a whole "
        "turn",
        "rad/s",
    )
    arm_tolerance: Share | None = key(
        None,
        "a frame in which an arm differs from its median length by more than this share is unusable; null = eight "
        "standard deviations of the recording's own lengths, but .5 % at least and 10 % at most",
    )
    model_offsets: bool = key(
        True,
        "whether markers off their hinges, or in planes at different distances, are modelled where the arms' lengths "
        "reveal this",
    )
    pivot_tolerance: Share = key(
        0.05,
        "pivot markers that lie off their median by more than this share of the first arm are not taken for the pivot, "
        "unless they are one arm from the joint and near those of their time, as with a moving camera",
    )
    pivot_window_s: NotNegative | None = key(
        None,
        "time over which the pivot is averaged; 0 = each frame has its own; null = the time that makes the first "
        "arm's length steadiest, so that a shaking camera is followed and a pivot at rest is not",
        "s",
    )
    rotation_deg: float = key(
        0.0, "direction of gravity in the image; 0 down, 90 right, -90 left, 180 up", "deg", ge=-360, le=360
    )
    rectify: RectifyKeys = key(RectifyKeys, "lens distortion and oblique view, corrected before angles are measured")
    smoothing_window_s: Positive | None = key(
        None,
        "window of the local polynomial that gives angles and speeds; null = for each frame, as long as it helps "
        "given the markers' own noise, from none to .08 s or 9 frames",
        "s",
    )
    smoothing_order: int = key(5, "order of this polynomial", ge=1, le=9)
    outlier_sigmas: Positive = key(
        12.0,
        "an angle is unusable if it is further from the polynomial than this many standard deviations of what is usual "
        "around it and in the recording",
    )
    outlier_floor_deg: NotNegative = key(
        0.5,
        "an angle closer to the polynomial than this, or than 5 % of the turn from frame to frame, is never an outlier",
        "deg",
    )
    min_usable_s: Positive = key(0.5, "a recording with less usable time than this is refused", "s")


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
        0.005, "longest Runge-Kutta step of the forecasts by which the fits are judged", "s"
    )


class CalibrationSettings(CalibrationKeys):
    """The same with what the workflow knows of the recordings."""

    arm1_m: Positive | None = key(0.091, "length of the first arm, for the implied frame rate; null = not known", "m")
    arm2_m: Positive | None = key(0.070, "length of the second arm; null = not known", "m")
    nominal_rate_hz: Positive | None = key(
        400.0, "frame rate by which the data's times were made; null = they were not made by one", "Hz"
    )
    rate_provenance: str = key("nominal rate of the dataset", "where that rate comes from")
