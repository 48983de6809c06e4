"""Settings of cutting recordings into chunks."""

from __future__ import annotations

import math
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from expertaug.measurements.settings import Cutting, check_shares
from expertaug.settings import NotNegative, Positive, Share, key, read

NOMINAL_HZ = 100.0  # for which length and strides are given where no rate is
FEWEST_POINTS = 7  # of a chunk by which an expert can be calibrated


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

    def at(self, analysis_rate_hz: float, where: str) -> ChunkSettings:
        """With a rate: chunks keep their duration, but for the points that calibrating needs.

        Arguments:
            analysis_rate_hz: frames per second of the recordings.
            where: path of the block, for messages.

        Raises:
            InputError: longer chunks do not fit the other keys.
        """
        if self.rate_hz is not None:
            return read(ChunkSettings, self.model_dump(), where)
        rate = analysis_rate_hz / max(1, math.ceil(analysis_rate_hz / NOMINAL_HZ - 1e-6))
        ratio = rate / NOMINAL_HZ
        length = max(FEWEST_POINTS, math.ceil((self.length - 1) * ratio - 1e-6) + 1) if ratio < 1 else self.length
        strides = {k: min(length, max(1, round(getattr(self, k) * ratio))) for k in ("stride", "evaluation_stride")}
        return read(
            ChunkSettings, {**self.model_dump(), "rate_hz": float(f"{rate:.9g}"), "length": length, **strides}, where
        )

    @property
    def shares(self) -> tuple[float, float, float]:
        return self.train_share, self.validation_share, self.test_share


class ChunkSettings(ChunkKeys):
    """The same with a rate."""

    single: bool = key(False, "whether the recordings are of a single pendulum")
    rate_hz: Positive = key(NOMINAL_HZ, "points per second; the recordings' rate is a multiple of it", "Hz")  # type: ignore[assignment]
