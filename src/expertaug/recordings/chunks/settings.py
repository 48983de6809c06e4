"""Settings of cutting recordings into chunks."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from pydantic import model_validator

from expertaug.measurements.settings import Cutting
from expertaug.settings import NotNegative, Positive, Share, disagree, key


class ChunkSettings(Cutting):
    """Chunks of the recordings and their division into sets."""

    WHERE: ClassVar[str] = "chunks settings"

    rate_hz: Positive = key(100.0, "points per second; recordings.analysis_rate_hz is a multiple of it", "Hz")
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
        total = sum(self.shares)
        if min(self.shares) <= 0 or abs(total - 1) > 1e-6:
            positive = min(self.shares) > 0
            found = f"the shares sum to {total:g}" if positive else f"the shares are {list(self.shares)}"
            raise disagree(found, "they must sum to 1" if positive else "they must be positive and sum to 1")
        for k, seconds in enumerate(self.horizons_s):
            if points_until(seconds, self.rate_hz) <= self.length:
                last = (self.length - 1) / self.rate_hz
                raise disagree(f"found {seconds:g}", f"chunks end at {last:g} s already", f"horizons_s[{k}]")
        named = list(map(suffix, self.horizons_s))
        if len(set(named)) < len(named):
            raise disagree(f"found {self.horizons_s}", "give each once", "horizons_s")
        return self

    @property
    def horizons(self) -> dict[str, tuple[str, float]]:
        """Further sets by name: the split that they are of, and their length in s."""
        return {f"{split}_{suffix(s)}": (split, s) for s in self.horizons_s for split in ("validation", "test")}

    @property
    def shares(self) -> tuple[float, float, float]:
        return self.train_share, self.validation_share, self.test_share


def points_until(seconds: float, rate_hz: float) -> int:
    """Points from 0 to a time."""
    return round(seconds * rate_hz) + 1


def suffix(seconds: float) -> str:
    """A length as the end of a set's name: 1s, 500ms."""
    return f"{seconds:g}s" if float(seconds).is_integer() else f"{round(1000 * seconds)}ms"
