"""Settings of importing marker CSVs of the IBM layout."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from expertaug.settings import Positive, Settings, Share, key
from expertaug.wording import PATTERNS

Sha256 = Annotated[str, Field(pattern=PATTERNS["sha256"])]


class ArchiveSettings(Settings):
    """Of unpacking the dataset's archive."""

    WHERE: ClassVar[str] = "archive settings"

    sha256: Sha256 | None = key(None, "SHA-256 of the archive; null = not checked")


class MarkerSettings(Settings):
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
