"""Settings of measurements of your own: files, their columns, the grid of times, chunks and sets (data.files)."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, Field, model_validator

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
    Seed,
    Settings,
    Share,
    by_shape,
    disagree,
    key,
    wrong,
)


class ChunkLimits(Settings):
    """Chunks of each set, at most."""

    train: Count | None = key(LEFT_OUT, "of the training set; null = all")
    validation: Count | None = key(LEFT_OUT, "of the validation set; null = all")
    test: Count | None = key(LEFT_OUT, "of the test set; null = all")


class Cutting(Settings):
    """How series are cut into chunks."""

    length: int = key(20, "points of a chunk", ge=2, le=MANY)
    phases: Literal["all", "first"] = key(
        "all",
        "of a chunk of every n-th point: all = chunks from each of the n interleaved series; first = from one",
    )
    stride: Count = key(5, "points from one training chunk's start to the next, at most the length")
    evaluation_stride: Count = key(20, "the same for validation and test")
    max_chunks: Annotated[Annotated[Count, ONE] | Annotated[ChunkLimits, KEYS], by_shape] | None = key(
        None, "at most so many chunks, evenly spread; null = all; one value, or one for each set"
    )
    min_chunks: Count = key(30, "a set with fewer is refused")
    horizons_s: list[Positive] = key(
        list,
        "lengths of further sets of validation and test chunks, from the same points, which are evaluated alone: 1.0 "
        "makes validation_1s and test_1s",
        "s",
    )

    @model_validator(mode="after")
    def _strides_fit(self) -> Self:
        for name in ("stride", "evaluation_stride"):
            if getattr(self, name) > self.length:
                raise disagree(f"found {getattr(self, name)}", f"give at most the length, {self.length}", name)
        return self

    @model_validator(mode="after")
    def _horizons_differ(self) -> Self:
        named = list(map(_suffix, self.horizons_s))
        if len(set(named)) < len(named):
            raise disagree(f"found {self.horizons_s}", "give each once", "horizons_s")
        return self

    def check_horizons(self, step_s: float) -> None:
        """Longer chunks are longer than the others; raises what a validator of settings raises.

        Arguments:
            step_s: from one point of a chunk to the next.
        """
        for k, seconds in enumerate(self.horizons_s):
            if points_in(seconds, step_s) <= self.length:
                last = (self.length - 1) * step_s
                raise disagree(f"found {seconds:g}", f"chunks end at {last:g} s already", f"horizons_s[{k}]")

    @property
    def horizons(self) -> dict[str, tuple[str, float]]:
        """Further sets by name: the split that they are of, and their length in s."""
        return {f"{split}_{_suffix(s)}": (split, s) for s in self.horizons_s for split in ("validation", "test")}

    def limit(self, split: str) -> int | None:
        """Chunks of a set, at most; None = all."""
        return getattr(self.max_chunks, split) if isinstance(self.max_chunks, ChunkLimits) else self.max_chunks


def points_in(seconds: float, step_s: float) -> int:
    """Points of a chunk of that length."""
    return round(seconds / step_s) + 1


def _suffix(seconds: float) -> str:
    """A length as the end of a set's name: 1s, 500ms."""
    return f"{seconds:g}s" if float(seconds).is_integer() else f"{round(1000 * seconds)}ms"


def check_shares(shares: tuple[float, float, float]) -> None:
    """Shares of the three sets are positive and sum to 1; raises what a validator of settings raises."""
    total, positive = sum(shares), min(shares) > 0
    if not positive or abs(total - 1) > 1e-6:
        found = f"the shares sum to {total:g}" if positive else f"the shares are {list(shares)}"
        raise disagree(found, "they must sum to 1" if positive else "they must be positive and sum to 1")


class Column(Settings):
    """A column of the files."""

    name: str = key(..., "as the files call it", min_length=1)
    unit: str | None = key(None, "of its numbers, as deg, mm or ms; null = the system's own; of the time datetime, too")
    factor: float = key(1.0, "what the column is multiplied by before that")
    offset: float = key(0.0, "what is added to it then, in the column's unit")


class Label(Settings):
    """Where an expert parameter is known from: a column, or a component's value at a chunk's first point."""

    name: str = key(LEFT_OUT, "the column, as the files call it", min_length=1)
    unit: str | None = key(None, "of its numbers; null = the system's own")
    start: str = key(LEFT_OUT, "the component whose first value in a chunk is the parameter", min_length=1)

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.name is None) == (self.start is None):
            raise disagree("found both name and start" if self.name else "found neither name nor start", "give one")
        return self


def _character(value: str) -> str:
    value = {"tab": "\t", "\\t": "\t", "space": " ", "whitespace": " "}.get(value, value)
    if len(value) != 1:
        raise wrong(f"found '{value}'", "give one character, tab or space")
    return value


Named = Annotated[Annotated[str, ONE] | Annotated[Column, KEYS], by_shape]
Texts = Annotated[Annotated[str, ONE] | Annotated[list[str], LIST, Field(min_length=1)], by_shape]


class TableKeys(Settings):
    """How a text file is read; of Parquet and NPZ nothing needs to be said."""

    names: Annotated[list[str], Field(min_length=2)] | None = key(
        None, "names of the columns, of files without a header; null = the first row that is no comment has them"
    )
    separator: Annotated[str, AfterValidator(_character)] | None = key(
        None, "between cells: a character, tab, or space for any blanks; null = what the first row has"
    )
    decimal: Literal[".", ","] = key(".", "what separates a number's fraction")
    skip_lines: int = key(0, "lines at the beginning of each file to leave out", ge=0, le=MANY)


class SplitSettings(Settings):
    """Which pieces train, which validate and which test."""

    by: Literal["random", "time", "quantity", "file", "column"] = key(
        "random",
        "random = pieces drawn by seed; time = of each trajectory the beginning trains, the end tests; quantity = "
        "pieces of low values train, of high ones test; file, column = as their names or a column's values say",
    )
    pieces: Literal["segments", "trajectories"] = key(
        "segments", "of random and quantity: segments = as long as a chunk; trajectories = whole ones"
    )
    train_share: Share = key(0.6, "of the pieces, or of each trajectory's points")
    validation_share: Share = key(0.2, "the same for validation")
    test_share: Share = key(0.2, "the same for test; the three sum to 1")
    seed: Seed = key(0, "of random")
    reverse: bool = key(False, "of time: the end trains and the beginning tests; of quantity: high values train")
    quantity: str = key(
        LEFT_OUT,
        "of quantity: arithmetic with components of the state (in their units) and other columns, as "
        "omega**2 / 2 - 1.4 * cos(theta), with abs, sqrt, exp, log, sin, cos, tan, arctan2, hypot, sign, minimum, "
        "maximum and pi",
    )
    statistic: Literal["mean", "max", "min", "range"] = key("mean", "of quantity: what counts of a piece's values")
    thresholds: Pair = key(
        LEFT_OUT, "of quantity: pieces up to the first train, beyond the second test; left out = by the shares"
    )
    column: str = key(LEFT_OUT, "of column: its name; the value of a piece's rows says the set")
    train: Texts = key(LEFT_OUT, "of file: names or globs, of column: values, that train; left out = train")
    validation: Texts = key(LEFT_OUT, "the same for validation; left out = validation")
    test: Texts = key(LEFT_OUT, "the same for test; left out = test")
    guard_s: NotNegative = key(0.0, "time left out between points of different sets, for smoothed columns", "s")

    @model_validator(mode="after")
    def _agree(self) -> Self:
        check_shares(self.shares)
        for needed in ("quantity", "column"):
            if self.by == needed and getattr(self, needed) is None:
                raise disagree(f"{needed} is missing", f"by is {needed}: give {needed}", needed)
        if self.thresholds is not None and self.thresholds[0] > self.thresholds[1]:
            raise disagree(f"found {list(self.thresholds)}", "the first must not exceed the second", "thresholds")
        return self

    @property
    def shares(self) -> tuple[float, float, float]:
        return self.train_share, self.validation_share, self.test_share

    def values(self, split: str) -> list[str]:
        """Names, globs or values of a set."""
        found = getattr(self, split)
        return [split] if found is None else [found] if isinstance(found, str) else list(found)


class MeasurementSettings(Cutting, TableKeys):
    """Measurements of your own, in tables."""

    WHERE: ClassVar[str] = "data.files"

    paths: Texts = key(..., "files or globs: CSV (also .txt, .tsv, .dat), Parquet or NPZ; they are never changed")
    checksums: str | None = key(None, "file of SHA-256 checksums of them, as sha256sum writes it; null = not checked")
    time: Named = key("t", "the column of times: its name, or name, unit, factor and offset")
    trajectory: str | None = key(None, "the column that tells trajectories of one file apart; null = a file is one")
    columns: Annotated[dict[str, Named], Field(min_length=1)] = key(
        ..., "component of the state → its column; components without one are taken as not measured"
    )
    inputs: dict[str, Named] = key(
        dict, "known input or covariate of a driven system → its column; a chunk without all their values is left out"
    )
    z_e: dict[str, Annotated[Annotated[str, ONE] | Annotated[Label, KEYS], by_shape]] = key(
        dict,
        "expert parameter → the column that knows it (cells may be empty), or start: COMPONENT, its value at a chunk's "
        "first point; of the others nothing is known",
    )
    angles: list[str] = key(
        list,
        "components that are angles and may jump by whole turns: they are unwrapped, and begin within half a turn",
    )
    unordered: Literal["refuse", "sort"] = key("refuse", "rows whose times go back: refuse, or sort them")
    duplicates: Literal["refuse", "first", "mean"] = key(
        "refuse", "rows of one time that differ: refuse, or take the first, or the mean; rows that repeat count once"
    )
    step_s: Positive | None = key(
        None, "time from point to point of a chunk, a multiple of the rows' own; null = the rows' own", "s"
    )
    tolerance: Share = key(0.1, "how far a row's time may lie off the grid of points, as a part of the rows' step")
    uneven: Literal["mask", "interpolate", "own"] = key(
        "mask",
        "mask = rows lie on a grid of times, points without a row count as not measured; interpolate = cubic splines "
        "through the rows, whose error is told in splits.json; own = rows keep their times: they lie on a finer grid, "
        "step_s apart (left out = a tenth of the usual time from row to row), in which lengths and strides count",
    )
    longest_gap: int = key(5, "missing points in a row that a chunk may span; a longer gap ends it", ge=0, le=MANY)
    min_seen: Share = key(
        0.7,
        "part of a chunk's values that must have been measured, of the components with a column; at 1, with a column "
        "for each component, models may rely on windows without gaps",
    )
    split: SplitSettings = key(SplitSettings, "which pieces train, which validate and which test")

    @model_validator(mode="after")
    def _horizons_are_longer(self) -> Self:
        if self.step_s is not None:
            self.check_horizons(self.step_s)
        return self

    @property
    def files(self) -> list[str]:
        return [self.paths] if isinstance(self.paths, str) else list(self.paths)


def column_of(named: str | Column) -> Column:
    """A column from either way of writing it."""
    return Column(name=named) if isinstance(named, str) else named


def label_of(named: str | Label) -> Label:
    """A label from either way of writing it."""
    return Label(name=named) if isinstance(named, str) else named
