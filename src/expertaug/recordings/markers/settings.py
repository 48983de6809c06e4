"""Settings of the marker tracker."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from expertaug.errors import InputError
from expertaug.recordings.markers.appearance import Appearance
from expertaug.recordings.options import read_settings

OPEN = ("marker_diameter_px", "arm1_px", "arm2_px")  # measured where they are null


@dataclass(frozen=True)
class TrackSettings:
    """Settings of the tracker; lengths in px.

    Attributes:
        markers: their style and colours.
        marker_diameter_px: approximate diameter of a marker in the frames; null: measured.
        arm1_px, arm2_px: pivot to joint and joint to tip; null: estimated from frames spread over the recording.
        arm_tolerance_px: an arm further than this from its length makes the frame unusable (``arm_length``).
        arm_search_px: half width of the ring round the parent in which a marker is searched.
        diameter_tolerance_px: a fitted disk may differ this much from the expected diameter.
        rim_tolerance_px: a rim point this near the fitted circle counts as on it.
        min_rim_share: share of rim points on the circle up to which a disk is not taken for a marker.
        max_residual_px: distance between the centres of the rim and of what is inside it above which a frame is
            unusable (``residual``: something covers a part of the marker).
        min_level: luma, 0 to 255, that the darkest sector of a quadrant disk exceeds and the background does not.
        calibration_frames: frames from which arm lengths and diameter are estimated.
        max_lost_share: share of unusable frames above which the video is refused.
    """

    markers: Appearance = field(default_factory=Appearance)
    marker_diameter_px: float | None = 25.0
    arm1_px: float | None = None
    arm2_px: float | None = None
    arm_tolerance_px: float = 2.0
    arm_search_px: float = 10.0
    diameter_tolerance_px: float = 4.0
    rim_tolerance_px: float = 0.6
    min_rim_share: float = 0.5
    max_residual_px: float = 0.6
    min_level: float = 24.0
    calibration_frames: int = 60
    max_lost_share: float = 0.25

    @classmethod
    def from_mapping(cls, settings: Mapping[str, object] | None) -> TrackSettings:
        """Read and check a mapping.

        Raises:
            InputError: a key is unknown or a value out of range.
        """
        where = "track_markers settings"
        made = read_settings(cls, settings, "track_markers")
        if not isinstance(made.markers, Appearance):
            made = replace(made, markers=Appearance.from_mapping(made.markers))
        for name, value in vars(made).items():
            if name == "markers" or (value is None and name in OPEN):
                continue
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
                raise InputError(where, f"{name} is {value!r}", "it must be a number of 0 or more")
        limits = {
            "marker_diameter_px": (8, 400),
            "min_rim_share": (0, 1),
            "max_lost_share": (0, 1),
            "min_level": (1, 254),
        }
        for name, (low, high) in limits.items():
            if getattr(made, name) is not None and not low <= getattr(made, name) <= high:
                raise InputError(where, f"{name} is {getattr(made, name)}", f"it must be from {low} to {high}")
        for name in ("arm1_px", "arm2_px", "calibration_frames"):
            value = getattr(made, name)
            if value is not None and value < 1:
                raise InputError(where, f"{name} is {value}", "it must be 1 or more")
        return made
