"""Settings of the rendered recordings, and the ranges of their launches."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from expertaug.settings import NotNegative, Pair, Positive, PositivePair, Range, Seed, Settings, disagree, key

SPEEDS = Literal["ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow"]
LARGEST = 8192  # px of an image's side
MOST = 10_000  # recordings


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


class RenderSettings(Settings):
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


class Rendered(RenderSettings):
    """The same where the number of recordings is asked for."""

    count: int = key(21, "number of recordings", ge=1, le=MOST)  # type: ignore[assignment]
