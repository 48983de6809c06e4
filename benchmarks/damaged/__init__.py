"""Damaged and hostile recordings, made from small sound ones (:mod:`damaged.base`); a seed gives the same bytes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from damaged.base import EITHER, Case
from damaged.tables import archives, tables
from damaged.videos import boxes, videos


def damaged(bases: dict[str, Case], seed: int, every: int = 1) -> Iterator[Case]:
    """The named cases; of the cut, zeroed and garbled files one in ``every``."""
    rng = np.random.default_rng(seed)
    for base in bases.values():
        yield base
        for name, data, expected in list(_spoiled(base.data, rng))[::every]:
            yield Case(f"{base.name}: {name}", base.kind, base.name, base.suffix, data, expected)
    for name in ("csv", "tar", "zip"):
        one = bases[name]
        yield Case(f"alien: video called {one.suffix}", one.kind, "", one.suffix, bases["mp4"].data)
    yield from videos(bases)
    yield from tables(bases["csv"].data)
    yield from archives(bases["csv"].data)


def mutant(bases: dict[str, Case], seed: int, index: int) -> Case:
    """A sound file with a few random edits; number ``index`` does not depend on the others."""
    rng = np.random.default_rng([seed, index])
    base = list(bases.values())[rng.integers(len(bases))]
    data = bytearray(base.data)
    for _ in range(rng.integers(1, 5)):
        if not data:
            break
        at, length = int(rng.integers(len(data))), int(2 ** rng.uniform(0, 9))
        edit = rng.integers(7)
        if edit == 0:
            data[at] ^= 1 << int(rng.integers(8))
        elif edit == 1:
            data[at] = int(rng.choice([0, 1, 127, 128, 255, 10, 44, 45, 46, 101, 110]))
        elif edit == 2:
            data[at : at + length] = rng.integers(0, 256, len(data[at : at + length]), dtype=np.uint8).tobytes()
        elif edit == 3:
            data[at : at + length] = bytes(len(data[at : at + length]))
        elif edit == 4:
            del data[at : at + length]
        elif edit == 5:
            data[at:at] = data[int(rng.integers(len(data))) :][:length]
        else:
            del data[at:]
    return Case(f"mutant {index} of {base.name}", base.kind, base.name, base.suffix, bytes(data), EITHER)


def _spoiled(data: bytes, rng: np.random.Generator) -> Iterator[tuple[str, bytes, str]]:
    """Truncations between and within a file's parts, zeroed, garbled, inserted and missing stretches."""
    marks = {at for at, _ in boxes(data)} | {int(share * len(data)) for share in np.linspace(0.02, 0.98, 25)}
    cuts = sorted({at + shift for at in marks for shift in (0, 4, 8) if 0 <= at + shift < len(data)})
    for at in cuts:
        yield f"cut at {at}", data[:at], EITHER
    yield "last byte missing", data[:-1], EITHER
    yield "twice", data + data, EITHER
    yield "first half twice", data[: len(data) // 2] + data, EITHER
    for length in (1, 16, 256, 2048):
        for at in rng.integers(0, len(data), 8).tolist():
            end = min(at + length, len(data))
            noise = rng.integers(0, 256, end - at, dtype=np.uint8).tobytes()
            yield f"{length} zeroed at {at}", data[:at] + bytes(end - at) + data[end:], EITHER
            yield f"{length} garbled at {at}", data[:at] + noise + data[end:], EITHER
            yield f"{length} missing at {at}", data[:at] + data[end:], EITHER
            yield f"{length} inserted at {at}", data[:at] + noise + data[at:], EITHER
