"""Settings of cutting recordings into chunks."""

from __future__ import annotations

import math
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from expertaug.measurements.settings import Cutting, check_shares
from expertaug.settings import NotNegative, Positive, Share, disagree, key, read

NOMINAL_HZ = 100.0  # for which length and strides are given where no rate is
FEWEST_POINTS = 7  # of a chunk by which an expert can be calibrated


class ChunkKeys(Cutting):
    """Chunks of the recordings and their division into sets."""

    WHERE: ClassVar[str] = "chunks settings"

    rate_hz: Positive | None = key(
        None,
        "points per second, of which recordings.analysis_rate_hz is a multiple; null = the highest up to 100, and "
        "length and strides, given for 100, are scaled to it",
        "Hz",
    )
    by: Literal["energy", "time"] = key(
        "energy",
        "energy = low energies train, high ones test; time = of each recording the start tests, the end trains",
    )
    train_share: Share = key(0.4, "of the energy's blocks, or of each recording's duration")
    validation_share: Share = key(0.3, "the same for validation")
    test_share: Share = key(0.3, "the same for test; the three sum to 1")
    guard_s: NotNegative = key(
        0.06, "time left out between frames of different sets, since angles are smoothed over their neighbours", "s"
    )
    horizons_s: list[Positive] = key(
        list,
        "lengths of further sets of validation and test chunks, from the same frames, which are evaluated alone: 1.0 "
        "makes validation_1s and test_1s",
        "s",
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        check_shares(self.shares)
        for k, seconds in enumerate(self.horizons_s):
            rate = self.rate_hz or NOMINAL_HZ
            if points_until(seconds, rate) <= self.length:
                last = (self.length - 1) / rate
                raise disagree(f"found {seconds:g}", f"chunks end at {last:g} s already", f"horizons_s[{k}]")
        named = list(map(suffix, self.horizons_s))
        if len(set(named)) < len(named):
            raise disagree(f"found {self.horizons_s}", "give each once", "horizons_s")
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
    def horizons(self) -> dict[str, tuple[str, float]]:
        """Further sets by name: the split that they are of, and their length in s."""
        return {f"{split}_{suffix(s)}": (split, s) for s in self.horizons_s for split in ("validation", "test")}

    @property
    def shares(self) -> tuple[float, float, float]:
        return self.train_share, self.validation_share, self.test_share


class ChunkSettings(ChunkKeys):
    """The same with a rate."""

    single: bool = key(False, "whether the recordings are of a single pendulum")
    rate_hz: Positive = key(NOMINAL_HZ, "points per second; the recordings' rate is a multiple of it", "Hz")  # type: ignore[assignment]


def points_until(seconds: float, rate_hz: float) -> int:
    """Points from 0 to a time."""
    return round(seconds * rate_hz) + 1


def suffix(seconds: float) -> str:
    """A length as the end of a set's name: 1s, 500ms."""
    return f"{seconds:g}s" if float(seconds).is_integer() else f"{round(1000 * seconds)}ms"
