"""Dates, times and durations of a column as seconds.

A column of dates has one reading: whether the day or the month comes first is decided by all of its cells together.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from expertaug.errors import InputError

Texts = Any  # pandas' Series of texts, which is not imported before it is needed
DURATION = r"^\s*(?:(?P<h>\d+):)?(?P<m>\d{1,3}):(?P<s>\d{2}(?:[.,]\d+)?)\s*"
TWO_PARTS = re.compile(r"\s*\d{1,3}:\d{2}\s*")  # hours and minutes, or minutes and seconds
NUMBERED_DATE = r"^\s*(\d{1,2})([./-])(\d{1,2})\2(?:\d{4}|\d{2})(?!\d)"
NO_TIME_OF_DAY = r"[T ]0?0:00(:00([.,]0+)?)?\s*$"  # which a spreadsheet adds to a date
CLOCK = "write them as 2024-05-31T12:00:00.25, or set data.files.time_format, as '%d.%m.%Y %H:%M:%S'"


def seconds(path: Path, name: str, cells: np.ndarray, pattern: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Dates and times, or durations, as seconds from the first of them on (n,); and which cells are none (n,).

    Arguments:
        cells: texts, or moments as a Parquet file has them, (n,).
        pattern: as strptime's; None: ISO dates, dates by day and month, ``h:mm:ss`` and ``mm:ss.ff`` are told apart.

    Raises:
        InputError: the cells do not tell whether the day or the month comes first.
    """
    import pandas as pd

    texts = pd.Series(cells)
    of_text = texts.dtype == object or isinstance(texts.dtype, pd.StringDtype)
    if pattern is not None:
        times = pd.to_datetime(texts.astype(str).str.strip(), errors="coerce", utc=True, format=pattern)
    elif of_text and texts.astype(str).str.fullmatch(DURATION).all():
        times = _durations(texts.astype(str))
    else:
        first = of_text and _day_comes_first(path, name, texts.astype(str))
        times = pd.to_datetime(texts, errors="coerce", utc=True, format="mixed", dayfirst=first)
    none = times.isna().to_numpy()
    since = times - times[~none].iloc[0] if not none.all() else times - times
    return since.dt.total_seconds().to_numpy(), none


def _durations(texts: Texts) -> Any:
    """Hours, minutes and seconds; of two parts the first are minutes where the second have a fraction, or where there
    are more than there are hours."""
    import pandas as pd

    parts = texts.str.extract(DURATION)
    first, last = pd.to_numeric(parts["m"]), parts["s"].str.replace(",", ".")
    if parts["h"].isna().all() and not last.str.contains(".", regex=False).any() and first.max() < 24:
        parts["h"], first, last = first, pd.to_numeric(last), "0"
    hours = pd.to_timedelta(pd.to_numeric(parts["h"]).fillna(0).astype("int64"), unit="h")
    return hours + pd.to_timedelta(first.astype("int64"), unit="min") + pd.to_timedelta(last + "s")


def may_be_minutes(cells: np.ndarray) -> bool:
    """Whether 10:30 in these cells (n,) may be hours and minutes as well as minutes and seconds."""
    texts = [str(cell) for cell in cells]
    return all(map(TWO_PARTS.fullmatch, texts)) and max(int(text.partition(":")[0]) for text in texts) < 24


def _day_comes_first(path: Path, name: str, texts: Texts) -> bool:
    """Of dates such as 03/04/2024, whether the day comes first; False of others.

    Raises:
        InputError: no cell says it, or they disagree.
    """
    import pandas as pd

    parts = texts.str.extract(NUMBERED_DATE)
    numbered = parts[0].notna()
    if not numbered.any():
        return False
    days, months = (pd.to_numeric(parts[k], errors="coerce") > 12 for k in (0, 2))
    example = texts[numbered].iloc[0].strip()
    remedy = "set data.files.time_format, such as '%d/%m/%Y' or '%m/%d/%Y' (inspect-data: --set time_format=…)"
    if days.any() and months.any():
        day_first, other = texts[days].iloc[0].strip(), texts[months].iloc[0].strip()
        raise InputError(path, f"column '{name}' has the day first in '{day_first}' and the month in '{other}'", remedy)
    if not days.any() and not months.any():
        problem = f"column '{name}': '{example}' may have the day or the month first, and no cell decides it"
        raise InputError(path, problem, remedy)
    return bool(days.any())


def join_texts(dates: np.ndarray, clocks: np.ndarray) -> np.ndarray:
    """Dates and times of day, (n,) each, as one text of both."""
    return np.array(
        [f"{re.sub(NO_TIME_OF_DAY, '', str(a)).strip()} {b}" for a, b in zip(dates, clocks, strict=True)], dtype=object
    )
