"""A recording's angles.json: its calibration, its gaps, what its motion implies and what is doubtful."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from expertaug.errors import InputError
from expertaug.files import write_json

Count = Annotated[int, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]


class TimingSummary(BaseModel):
    """What was found of a recording's times (:class:`expertaug_recordings.angles.marker_table.Timing`)."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)

    repeated: Count = 0
    dropped: Count = 0
    torn: Count = 0
    blended: Count = 0
    blended_used: bool = False
    uneven_ms: float = 0.0
    frames_hz: Positive | None = None
    error_deg: tuple[float, float] | None = None
    converted_from_hz: Positive | None = None


class RectifiedSummary(BaseModel):
    """What was done to the places of the markers (:class:`expertaug_recordings.angles.rectify.Rectified`)."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)

    by: str
    stretch: Positive
    direction_deg: float
    moved_px: float
    board_px: float | None
    arms_before: tuple[float, float]


class RecordingSummary(BaseModel):
    """What :func:`expertaug_recordings.angles.measure.measure_angles` says of one recording.

    Attributes:
        recording: its name.
        pendulum: of a single one what belongs to a second arm repeats the first's; G1 is its ω0².
        frames, duration_s: how many, and over how many seconds.
        tracked_share, usable_share: shares of the frames that the tracker found and that are measured.
        arm1_px, arm1_std_px, arm2_px, arm2_std_px: median lengths of the arms and their spread.
        pivot_x_px, pivot_y_px: median place of the pivot.
        noise1_deg, noise2_deg: spread of the two angles as measured, by that of the arms' lengths.
        uncertainty1_deg, uncertainty2_deg, uncertainty1_rad_s, uncertainty2_rad_s: medians of the standard
            uncertainties of the angles and the speeds that were made of them.
        offsets_px: how far markers are off their hinges, where they are: ``pivot`` and ``tip`` by a constant in the
            image, ``joint_arm1`` and ``joint_arm2`` on either arm.
        pivot_window_s: over which the pivot was averaged; None where it is taken to be at rest.
        unsmoothed_share: shares of the two angles that are as measured, since no polynomial follows the motion.
        gaps, longest_gap_frames: runs of frames without angles.
        interpolated, rejected_arm_length, rejected_outlier: frames.
        reasons: frames by reason.
        timing: frames repeated and missing, and what resampling cost.
        span_s: first and last second (None: the end) that are used of a longer recording; None where all is.
        rectified: how lens and view were undone; None where they were not.
        rolling_row_us: from row to row of a shutter that rolls; None where the lengths tell of none.
        rate_hz, rate_provenance: stated frame rate and where it is known from.
        implied_rate_hz: by the motion; None where the first arm's length is not known.
        rotation_deg: stated direction of gravity in the image: 0 down, 90 right.
        implied_rotation_deg: by the motion; None where it does not tell.
        rotation_error_deg: standard uncertainty of the stated direction, which all angles share.
        warnings: what the motion contradicts.
        constants, friction: those of the pendulum that moves like that, in the stated time.
        misfit_deg: how far both angles are off the motion of any pendulum, rms, the markers' noise included; None where
            no stretch tells.
        r2_1, r2_2: shares of the motion of the two angles that they explain.
        energy_start, energy_end: in s⁻².
    """

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)

    recording: str
    pendulum: Literal["double", "single"] = "double"
    frames: Annotated[int, Field(gt=0)]
    duration_s: Positive
    tracked_share: Share
    usable_share: Share
    arm1_px: Positive
    arm1_std_px: float
    arm2_px: Positive
    arm2_std_px: float
    pivot_x_px: float
    pivot_y_px: float
    noise1_deg: float
    noise2_deg: float
    uncertainty1_deg: float
    uncertainty2_deg: float
    uncertainty1_rad_s: float
    uncertainty2_rad_s: float
    offsets_px: dict[str, float]
    pivot_window_s: float | None
    unsmoothed_share: tuple[Share, Share]
    gaps: Count
    longest_gap_frames: Count
    interpolated: Count
    rejected_arm_length: Count
    rejected_outlier: Count
    reasons: dict[str, Count]
    timing: TimingSummary = TimingSummary()
    span_s: tuple[float, float | None] | None = None
    rectified: RectifiedSummary | None = None
    rolling_row_us: float | None = None
    rate_hz: Positive
    rate_provenance: str
    implied_rate_hz: Positive | None
    rotation_deg: float
    implied_rotation_deg: float | None
    rotation_error_deg: float = 0.0
    warnings: list[str]
    constants: Annotated[dict[Literal["B1", "G1", "B2", "G2"], float], Field(min_length=4)]
    friction: tuple[float, float]
    misfit_deg: tuple[float, float] | None = None
    r2_1: float
    r2_2: float
    energy_start: float
    energy_end: float

    def save(self, path: str | Path) -> None:
        """Write it as JSON, atomically."""
        write_json(path, self.model_dump())

    @classmethod
    def load(cls, path: str | Path) -> RecordingSummary:
        """Read what :meth:`save` wrote.

        Raises:
            InputError: the file is missing, is not JSON, or lacks a value or has one of another kind.
        """
        try:
            return cls.model_validate_json(Path(path).read_bytes())
        except FileNotFoundError as error:
            raise InputError(path, "no such file", "run measure_angles") from error
        except OSError as error:
            raise InputError(path, f"cannot be read ({error.strerror})", "run measure_angles again") from error
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            key = ".".join(str(part) for part in first["loc"]) or "JSON"
            raise InputError(path, f"{key}: {first['msg']}", "run measure_angles again") from error
