"""What the stages of recordings may be told: the block ``recordings`` of a configuration, chunks, and each stage's job.

``…Keys`` are keys of the configuration; ``…Job`` is all that a stage's job takes, by the name of its subcommand.  No
numerical library is loaded here.
"""

import math
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from expertaug.measurements.settings import Cutting, check_shares
from expertaug.settings import (
    KEYS,
    LEFT_OUT,
    LIST,
    MANY,
    ONE,
    Count,
    NotNegative,
    Pair,
    Positive,
    PositivePair,
    Range,
    Seed,
    Settings,
    Share,
    by_shape,
    disagree,
    key,
    read,
)
from expertaug.wording import PATTERNS
from expertaug_recordings.corrections import Correction
from expertaug_recordings.markers.appearance import Appearance

RENDERED = "rendered at this rate"  # where the rate of what this project rendered is known from: nothing can be wrong


SPEEDS = Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow"]
LARGEST = 8192  # px of an image's side
MOST = 10_000  # recordings
PLAIN_DIAMETER = 25.0  # px, up to which the tolerances in px are the same; then they grow with it
DIAMETER, RIM = 4.0, 0.6  # px of a plain diameter, where nothing is given
NOMINAL_HZ = 100.0  # for which length and strides are given where no rate is
FEWEST_POINTS = 7  # of a chunk by which an expert can be calibrated


class RigidBody(Settings):
    """Constants of the rigid double pendulum, fitted to the real recordings in their nominal time."""

    B1: Positive = key(0.103, "coupling of the first arm to the second")
    G1: Positive = key(69.4, "gravity on the first arm", "s⁻²")
    B2: Positive = key(1.35, "coupling of the second arm to the first")
    G2: Positive = key(93.5, "gravity on the second arm", "s⁻²")


class LaunchSettings(Settings):
    """Ranges from which each recording's start is drawn."""

    energy: Range = key((200.0, 330.0), "mechanical energy", "s⁻²")
    theta1: Range = key((1.3, 3.1), "angle of the first arm; in half of the launches, both angles are mirrored", "rad")
    theta2: Range = key((-0.5, 1.5), "angle of the second arm", "rad")
    speed_ratio: Range = key((0.8, 2.5), "ratio of the second arm's speed to the first arm's")


class RenderVideoJob(Settings):
    """The embedded default, simulated and rendered as video."""

    WHERE: ClassVar[str] = "recordings.rendered"

    seed: Seed = key(0, "seed of all random draws")
    # None where it is not known: no recording depends on it.
    count: Annotated[int, Field(ge=1, le=MOST)] | None = key(None, "number of recordings")
    duration_s: Positive = key(40.0, "length of a recording", "s")
    rate_hz: Positive = key(400.0, "frames per second", "Hz")
    image_size_px: int = key(480, "side of the square image; an even number", "px", ge=64, le=LARGEST, multiple_of=2)
    crf: int = key(18, "constant rate factor of the H.264 encoder; 0 = lossless", ge=0, le=51)
    preset: SPEEDS = key("superfast", "speed preset of the encoder")
    noise: float = key(4.0, "standard deviation of the sensor noise at full white, in grey levels", ge=0, le=50)
    exposure_s: Positive = key(90.0e-6, "exposure time of a frame, which blurs moving parts", "s")
    pixels_per_metre: Positive = key(1294.5, "scale of the image", "px/m")
    arms_m: PositivePair = key((0.091, 0.0696), "lengths of the two arms between marker centres", "m")
    pivot_px: Pair = key((238.0, 239.0), "mean x and y of the pivot", "px")
    pivot_spread_px: NotNegative = key(4.0, "half the range over which the pivot differs between recordings", "px")
    constants: RigidBody = key(RigidBody, "constants of the rigid double pendulum")
    friction: Annotated[tuple[NotNegative, NotNegative], Field(strict=False)] = key(
        (0.045, 0.08), "viscous friction of the two joints", "s⁻¹"
    )
    launch: LaunchSettings = key(LaunchSettings, "ranges from which each recording's start is drawn")

    @model_validator(mode="after")
    def _pivot_is_in_the_image(self) -> Self:
        inside = (self.pivot_spread_px < v < self.image_size_px - self.pivot_spread_px for v in self.pivot_px)
        if not all(inside):
            raise disagree(
                f"found {list(self.pivot_px)}", f"it must lie in the {self.image_size_px} px image", "pivot_px"
            )
        return self

    @property
    def frames(self) -> int:
        """Frames of one recording."""
        return max(1, round(self.duration_s * self.rate_hz))


class Rendered(RenderVideoJob):
    """The same where the number of recordings is asked for."""

    count: int = key(21, "number of recordings", ge=1, le=MOST)  # type: ignore[assignment]


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


class StatedTimes(TimeKeys):
    """What is stated of a recording's times, by which its frames are opened."""

    WHERE: ClassVar[str] = "recordings.videos"

    rate_hz: Positive | None = key(
        None, "frame rate at which the video was taken; null = the one in its metadata", "Hz"
    )
    rate_provenance: str | None = key(None, "where that rate is known from")


class ExtractFramesJob(StatedTimes):
    """How frames are taken from a video."""

    WHERE: ClassVar[str] = "recordings"

    analysis_rate_hz: Positive | None = key(
        None, "frames per second that are analysed, at most the video's; null = all", "Hz"
    )
    expected_frames: Count | None = key(None, "frames that the video must have; null = as many as its metadata says")
    image_size_px: Annotated[Annotated[Size, ONE] | Annotated[SizePair, LIST], by_shape] | None = key(
        None, "side of a square image, or width and height, that the video must have; null = any", "px"
    )


class ColourKeys(Settings):
    """A colour's ranges."""

    hue: Pair = key(
        ..., "first and last hue in degrees, 0 to 360; the range passes through 0 if the first is larger", "deg"
    )
    saturation: Range = key((0.25, 1.0), "lowest and highest saturation, 0 to 1")
    value: Range = key((0.12, 1.0), "lowest and highest value, 0 to 1")


Polygon = Annotated[list[Pair], Field(min_length=2, max_length=100)]
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

    markers: AppearanceKeys = key(AppearanceKeys, "how the markers look; expertaug inspect-video VIDEO proposes this")
    masks: list[Polygon] = key(
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
        None, "how much the diameter of a fitted disk may differ; null = 4, or 0.16 of a diameter over 25", "px"
    )
    rim_tolerance_px: Positive | None = key(
        None,
        "a rim point this close to the fitted circle counts as on it; null = 0.6, or 0.024 of a diameter over 25",
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


class TrackMarkersJob(TrackKeys):
    """The same with the appearance that the keys mean, and the tolerances in px that they leave open."""

    @model_validator(mode="after")
    def _markers_can_be_told_apart(self) -> Self:
        _ = self.appearance
        return self

    @cached_property
    def appearance(self) -> Appearance:
        return Appearance.from_mapping(self.markers.model_dump())

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


Sha256 = Annotated[str, Field(pattern=PATTERNS["sha256"])]


class UnpackMarkersJob(Settings):
    """Of unpacking the dataset's archive."""

    WHERE: ClassVar[str] = "archive settings"

    sha256: Sha256 | None = key(None, "SHA-256 of the archive; null = not checked")


class ImportMarkersJob(Settings):
    """Marker CSVs in the layout of IBM's Double Pendulum Chaotic dataset."""

    WHERE: ClassVar[str] = "markers settings"

    rate_hz: Positive = key(400.0, "frames per second", "Hz")
    rate_provenance: str = key("nominal rate of the dataset", "where that rate comes from; kept in the reports")
    scale: Positive = key(5.0, "number in the file = offset + scale × px", "1/px")
    offset: float = key(2.0, "see scale")
    arm_tolerance: Share = key(
        0.1, "an arm that differs from its median length by more than this share does not count as an arm"
    )
    arm_outliers: Share = key(0.05, "a file with more than this share of such rows is refused")


InnerCorners = Annotated[int, Field(ge=3, le=100)]


class RectifyKeys(Settings):
    """From the image to the plane of motion, before angles are measured."""

    ellipse: bool = key(
        False,
        "whether the view is found from the arms themselves, which are equally long in every direction; expertaug "
        "inspect-video proposes it where it helps",
    )
    checkerboard: str | None = key(
        None,
        "a picture of a checkerboard, taken in the same way as the video, or a folder of such pictures; the first "
        "shows the board in the plane of motion or parallel to it, except with ellipse, where the pictures determine "
        "only the lens",
    )
    corners: Annotated[tuple[InnerCorners, InnerCorners], Field(strict=False)] = key(
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
        "standard deviations of the recording's own lengths, but 0.5 % at least and 10 % at most",
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
    rotation_error_deg: NotNegative | None = key(
        None, "standard uncertainty of rotation_deg; null = by how well the motion agrees with it", "deg"
    )
    rectify: RectifyKeys = key(RectifyKeys, "lens distortion and oblique view, corrected before angles are measured")
    smoothing_window_s: Positive | None = key(
        None,
        "window of the local polynomial that gives angles and speeds; null = for each frame, as long as it helps "
        "given the markers' own noise, from none to 0.08 s or 9 frames",
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


class MeasureAnglesJob(AngleKeys):
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


class CalibrateJob(CalibrationKeys):
    """The same with what the workflow knows of the recordings."""

    arm1_m: Positive | None = key(0.091, "length of the first arm, for the implied frame rate; null = not known", "m")
    arm2_m: Positive | None = key(0.070, "length of the second arm; null = not known", "m")
    nominal_rate_hz: Positive | None = key(
        400.0, "frame rate by which the data's times were made; null = they were not made by one", "Hz"
    )
    rate_provenance: str = key("nominal rate of the dataset", "where that rate comes from")


class ChunkKeys(Cutting):
    """Chunks of the recordings and their division into sets."""

    WHERE: ClassVar[str] = "chunks settings"

    rate_hz: Positive | None = key(
        None,
        "points per second; the recordings' rate must be a multiple of it; null = the highest up to 100, and "
        "length and strides, given for 100, are scaled to it",
        "Hz",
    )
    by: Literal["energy", "time"] = key(
        "energy",
        "energy = low energies are for training, high ones for testing; time = the start of each recording is for "
        "testing, its end for training",
    )
    train_share: Share = key(0.4, "share of the energy blocks, or of each recording's duration, in the training set")
    validation_share: Share = key(0.3, "the same for validation")
    test_share: Share = key(0.3, "the same for test; the three sum to 1")
    guard_s: NotNegative = key(
        0.06, "time left out between frames of different sets, since angles are smoothed over neighbouring frames", "s"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        check_shares(self.shares)
        self.check_horizons(1 / (self.rate_hz or NOMINAL_HZ))
        return self

    def at(self, analysis_rate_hz: float, where: str) -> "SplitChunksJob":
        """With a rate: chunks keep their duration, but for the points that calibrating needs.

        Arguments:
            analysis_rate_hz: frames per second of the recordings.
            where: path of the block, for messages.

        Raises:
            InputError: longer chunks do not fit the other keys.
        """
        if self.rate_hz is not None:
            return read(SplitChunksJob, self.model_dump(), where)
        rate = analysis_rate_hz / max(1, math.ceil(analysis_rate_hz / NOMINAL_HZ - 1e-6))
        ratio = rate / NOMINAL_HZ
        length = max(FEWEST_POINTS, math.ceil((self.length - 1) * ratio - 1e-6) + 1) if ratio < 1 else self.length
        strides = {k: min(length, max(1, round(getattr(self, k) * ratio))) for k in ("stride", "evaluation_stride")}
        return read(
            SplitChunksJob, {**self.model_dump(), "rate_hz": float(f"{rate:.9g}"), "length": length, **strides}, where
        )

    @property
    def shares(self) -> tuple[float, float, float]:
        return self.train_share, self.validation_share, self.test_share


class SplitChunksJob(ChunkKeys):
    """The same with a rate."""

    single: bool = key(False, "whether the recordings are of a single pendulum")
    rate_hz: Positive = key(NOMINAL_HZ, "points per second; the recordings' rate is a multiple of it", "Hz")  # type: ignore[assignment]


class CutHorizonJob(Settings):
    """A set of long chunks."""

    WHERE: ClassVar[str] = "horizon settings"

    split: SplitChunksJob = key(..., "how the recordings are divided, with the set's length among horizons_s")
    set: str = key(..., "name of the set, such as test_1s")

    @model_validator(mode="after")
    def _is_a_horizon(self) -> Self:
        if self.set not in self.split.horizons:
            raise disagree(f"found {self.set}", f"there are {', '.join(self.split.horizons) or 'none'}", "set")
        return self


class OverlayView(Settings):
    """What is shown of a recording."""

    WHERE: ClassVar[str] = "overlay settings"

    fps: float = key(25.0, "maximum frame rate of the overlay", "Hz", gt=0, le=240)
    speed: Positive = key(0.25, "speed of the overlay; 1 = that of the recording")
    start_s: NotNegative = key(0.0, "time in the recording at which the overlay starts", "s")
    duration_s: Positive | None = key(
        10.0, "how much of the recording the overlay shows; null = all; parts with forecasts are always shown", "s"
    )


class OverlayJob(OverlayView, StatedTimes):
    """The same with the video's rate and times, as for extracting its frames."""


class ReviewRecordingJob(StatedTimes):
    """How the frames that are looked at are opened."""

    WHERE: ClassVar[str] = "review settings"


class OverlayKeys(OverlayView):
    """Videos with markers, arms, angles and forecasts drawn over the frames (the target overlay makes them)."""

    experiment: str | None = key(
        None,
        "experiment from which forecasts, if there are any, are drawn; null = the run's first experiment on recordings",
    )
    variants: list[str] | None = key(
        None, "methods for which forecasts are drawn, with a + for augmented versions; null = the experiment's last"
    )


class VideoKeys(TimeKeys):
    """Your own videos, in any usual container that FFmpeg reads, or folders of pictures."""

    path: Annotated[Annotated[str, ONE] | Annotated[list[str], LIST], by_shape] | None = key(
        None,
        "a folder, a file or a glob, or a list of these; each video and each folder of pictures is a recording, named "
        "after it",
    )
    rate_hz: Positive | None = key(None, "frames per second; null = as stated in the file", "Hz")
    rate_provenance: str | None = key(
        None, "where that rate comes from; kept in the reports; null = the file, or this configuration"
    )
    image_size_px: SizePair | None = key(None, "width and height that every video must have; null = any", "px")


class MarkerKeys(ImportMarkersJob):
    """Marker CSVs in the layout of IBM's Double Pendulum Chaotic dataset."""

    path: str | None = key(None, "a folder of CSVs, or an archive of it as .tar.gz or .zip")
    sha256: Sha256 | None = key(None, "SHA-256 of the archive; null = not checked")


class OwnKeys(Settings):
    """What differs in one recording from the blocks of these names."""

    tracking: dict[str, Any] = key(LEFT_OUT, "keys of recordings.tracking")
    angles: dict[str, Any] = key(LEFT_OUT, "keys of recordings.angles")
    videos: dict[str, Any] = key(LEFT_OUT, "keys of recordings.videos, except path")


class RecordingKeys(Settings):
    """Recordings of a double pendulum, from their source to angles."""

    source: Literal["rendered", "videos", "markers"] = key(
        "rendered", "rendered = simulated and drawn; videos = your files; markers = marker positions"
    )
    analysis_rate_hz: Positive = key(
        400.0,
        "frames per second that are analysed; the angles of a video with another or a variable rate are resampled to "
        "it",
        "Hz",
    )
    on_bad_recording: Literal["stop", "skip"] = key(
        "stop",
        "what happens if any stage refuses a recording: stop = the run ends; skip = it goes on without that "
        "recording, and the table of recordings says why",
    )
    checksums: str | None = key(
        None, "file with the SHA-256 checksums of the videos or marker CSVs, as sha256sum writes it; null = not checked"
    )
    corrections: str | None = key(
        None,
        "CSV of markers placed by hand, with the columns recording, frame, marker (pivot, joint, tip; all = do not "
        "use the frame), x, y",
    )
    arms_m: PositivePair | None = key(
        (0.091, 0.070),
        "lengths of the two arms, from which the frame rate that the motion implies is computed; null = not known",
        "m",
    )
    rendered: Rendered = key(Rendered, "the built-in default, simulated and rendered as video")
    videos: VideoKeys = key(VideoKeys, "your own videos, in any common container that FFmpeg reads")
    markers: MarkerKeys = key(MarkerKeys, "marker CSVs in the layout of IBM's Double Pendulum Chaotic dataset")
    tracking: TrackKeys = key(TrackKeys, "settings of the marker tracker; lengths in px")
    angles: AngleKeys = key(AngleKeys, "how arm angles are measured from marker positions")
    by_recording: dict[str, OwnKeys] = key(
        dict, "settings that differ between recordings, by the recording's name; expertaug inspect-video proposes them"
    )
    overlay: OverlayKeys = key(
        OverlayKeys,
        "videos with markers, arms, angles and forecasts drawn over the frames (the target overlay makes them)",
    )
