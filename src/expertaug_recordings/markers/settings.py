"""Settings of the marker tracker, and how a configuration says what the markers look like."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, ConfigDict, Field

from expertaug.settings import KEYS, MANY, ONE, Pair, Positive, Range, Settings, Share, by_shape, key
from expertaug_recordings.markers.appearance import Appearance


class ColourKeys(Settings):
    """A colour's ranges."""

    hue: Pair = key(
        ..., "first and last hue in degrees, 0 to 360; the range passes through 0 if the first is larger", "deg"
    )
    saturation: Range = key((0.25, 1.0), "lowest and highest saturation, 0 to 1")
    value: Range = key((0.12, 1.0), "lowest and highest value, 0 to 1")


Corners = Annotated[list[Pair], Field(min_length=2, max_length=100)]
Colour = Annotated[Annotated[str, ONE] | Annotated[ColourKeys, KEYS], by_shape]


class AppearanceKeys(Settings):
    """How the markers look; a colour by its name, or its ranges."""

    style: Literal["quadrant", "disk"] = key(
        "quadrant", "quadrant = two coloured and two white sectors, on a dark background; disk = one colour"
    )
    pivot: Colour | None = key("red", "colour of the marker at the fixed pivot; null = the pivot has no marker")
    joint: Colour = key("green", "colour of the marker between the arms")
    tip: Colour | None = key(
        "blue", "colour of the marker at the end of the second arm; null = a single pendulum, with the joint as its bob"
    )
    pivot_px: Pair | None = key(
        None, "x and y of a pivot without a marker; null = the centre of the circle on which the joint moves", "px"
    )


class TrackKeys(Settings):
    """Of the marker tracker; lengths in px."""

    WHERE: ClassVar[str] = "track_markers settings"

    markers: AppearanceKeys = key(AppearanceKeys, "how the markers look; expertaug inspect VIDEO proposes this")
    masks: list[Corners] = key(
        list,
        "parts of the image in which no markers are searched for (hands, text), given by the x and y of their "
        "corners; two corners are opposite corners of a rectangle",
        "px",
    )
    marker_diameter_px: Annotated[float, Field(ge=8, le=400)] | None = key(
        25.0, "approximate diameter of a marker; null = measured", "px"
    )
    arm1_px: Annotated[float, Field(ge=1)] | None = key(
        None, "distance from pivot to joint; null = estimated from the recording", "px"
    )
    arm2_px: Annotated[float, Field(ge=1)] | None = key(
        None, "distance from joint to tip; null = estimated from the recording", "px"
    )
    arm_tolerance_px: Positive | None = key(
        None,
        "a frame in which an arm differs from its length by more than this is unusable; null = by the recording's own "
        "spread, so that a marker off its hinge does no harm",
        "px",
    )
    arm_search_px: Positive | None = key(
        None, "half the width of the ring in which a marker is searched for; null = by diameter and spread", "px"
    )
    diameter_tolerance_px: Positive | None = key(
        None, "how much the diameter of a fitted disk may differ; null = 4, or .16 of a diameter over 25", "px"
    )
    rim_tolerance_px: Positive | None = key(
        None,
        "a rim point this close to the fitted circle counts as on it; null = .6, or .024 of a diameter over 25",
        "px",
    )
    min_rim_share: Share = key(0.5, "share of rim points on the circle below which a disk is not a marker")
    max_residual_px: Positive | None = key(
        None,
        "distance between the centre of a marker's rim and that of its inside above which a frame is unusable; "
        "null = by the recording's own distances, so that a pattern burnt into a disk does no harm",
        "px",
    )
    min_level: float = key(
        24.0, "luma that the darkest sector of a quadrant disk exceeds but the background does not", ge=1, le=254
    )
    calibration_frames: int = key(
        60, "number of frames from which the arm lengths and the diameter are estimated", ge=1, le=MANY
    )
    max_lost_share: Share = key(0.25, "share of unusable frames above which a video is refused")


def _appearance(value: object) -> object:
    return value if isinstance(value, Appearance) else Appearance.from_mapping(value)  # type: ignore[arg-type]


PLAIN_DIAMETER = 25.0  # px, up to which the tolerances in px are the same; then they grow with it
# px of a plain diameter, where nothing is given
ARM, SEARCH, DIAMETER, RIM, RESIDUAL = 2.0, 10.0, 4.0, 0.6, 0.6


class TrackSettings(TrackKeys):
    """The same with the appearance that the keys mean, and the tolerances in px that they leave open."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    markers: Annotated[Appearance, BeforeValidator(_appearance)] = Appearance()  # type: ignore[assignment]

    @property
    def scale(self) -> float:
        """By how much markers are larger than a plain diameter; 1 where they are not."""
        return max(1.0, (self.marker_diameter_px or PLAIN_DIAMETER) / PLAIN_DIAMETER)

    @property
    def diameter_tolerance(self) -> float:
        return self.diameter_tolerance_px or DIAMETER * self.scale

    @property
    def rim_tolerance(self) -> float:
        return self.rim_tolerance_px or RIM * self.scale
