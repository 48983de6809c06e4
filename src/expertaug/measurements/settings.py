"""Settings of measurements of your own: files, their columns, the grid of times, chunks and sets (data.files)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

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

    train: Count | None = key(LEFT_OUT, "maximum number of chunks in the training set; null = all")
    validation: Count | None = key(LEFT_OUT, "maximum number of chunks in the validation set; null = all")
    test: Count | None = key(LEFT_OUT, "maximum number of chunks in the test set; null = all")


class Cutting(Settings):
    """How series are cut into chunks."""

    length: int = key(20, "number of points in a chunk", ge=2, le=MANY)
    phases: Literal["all", "first"] = key(
        "all",
        "where chunks take every n-th point: all = chunks from each of the n interleaved series; first = from one",
    )
    stride: Count = key(
        5, "number of points from the start of one training chunk to the start of the next, at most the length"
    )
    evaluation_stride: Count = key(20, "the same for validation and test")
    max_chunks: Annotated[Annotated[Count, ONE] | Annotated[ChunkLimits, KEYS], by_shape] | None = key(
        None, "maximum number of chunks, spread evenly; null = all; one value, or one for each set"
    )
    min_chunks: Count = key(
        30, "a set with fewer chunks is refused; a split of recordings first has them begin nearer to each other"
    )
    horizons_s: list[Positive] = key(
        list,
        "chunk lengths of further validation and test sets, cut from the same points and used for evaluation only: "
        "1.0 makes validation_1s and test_1s",
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
        problem = f"the shares sum to {total:g}" if positive else f"the shares are {list(shares)}"
        raise disagree(problem, "they must sum to 1" if positive else "they must be positive and sum to 1")


class Column(Settings):
    """A column of the files."""

    name: str = key(..., "the column's name in the files", min_length=1)
    unit: str | None = key(
        None, "its unit, such as deg, mm or ms; null = the system's own; for the time column also datetime"
    )
    factor: float = key(1.0, "what the column is multiplied by before its unit is converted")
    offset: float = key(0.0, "what is then added, before the conversion, in the column's unit")
    formula: str | None = key(
        None,
        "what the column's numbers x are first replaced by, such as arcsin(x / 2.5): a calibration that is no straight "
        "line; the unit is then that of its values. Functions and operations as of split.quantity",
    )

    @property
    def is_plain(self) -> bool:
        """Whether its numbers stand as they are in the files."""
        return self == Column(name=self.name, unit=self.unit)


class Label(Settings):
    """Where an expert parameter is known from: a column, or a component's value at a chunk's first point."""

    name: str = key(LEFT_OUT, "the column's name in the files", min_length=1)
    unit: str | None = key(None, "unit of its numbers; null = the system's own")
    start: str = key(LEFT_OUT, "the component whose first value in a chunk is the parameter's value", min_length=1)

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


class Pivot(Settings):
    """A table in long format: a row for each time and sensor, its name in one column, its value in another."""

    name: str = key(..., "the column that says which sensor's value a row holds", min_length=1)
    value: str = key(..., "the column of the values", min_length=1)
    unit: str | None = key(None, "the column of their units; null = none")
    by: Annotated[list[str], Field(min_length=1)] | None = key(
        None, "the columns that rows of one moment share: times and trajectories; null = all others"
    )


class Beside(Settings):
    """Runs beside each other, as the wells of a plate: a column for each, and one of times for all."""

    columns: Annotated[list[str], Field(min_length=2)] = key(..., "the columns, one for each run")
    value: str = key(..., "what the column of their values is then called", min_length=1)
    name: str = key("run", "what the column that tells runs apart is then called", min_length=1)


class TableKeys(Settings):
    """How a table is read; of Parquet and NPZ only ``missing``, ``beside`` and ``pivot`` may need to be said."""

    names: Annotated[list[str], Field(min_length=2)] | None = key(
        None, "names of the columns, for files without a header; null = taken from the first row that is not a comment"
    )
    separator: Annotated[str, AfterValidator(_character)] | None = key(
        None, "what separates the cells: a character, tab, or space for any blanks; null = as in the first row"
    )
    decimal: Literal[".", ","] = key(".", "the decimal separator")
    thousands: Literal[".", ",", "'", " ", "\u00a0", "\u2009", "\u202f"] = key(
        LEFT_OUT, "what separates thousands, as the dot in 1.234,5; left out = nothing does"
    )
    skip_lines: int = key(0, "number of lines to skip at the beginning of each file", ge=0, le=MANY)
    missing: list[float | str] = key(
        LEFT_OUT,
        "numbers and texts by which the files say that nothing was measured, such as -999 or OVR; beside empty cells, "
        "nan and the like, which always do",
    )
    beside: Beside = key(
        LEFT_OUT,
        "for tables with runs beside each other, a column for each: the columns, and what is made of them; the runs "
        "are then below each other",
    )
    pivot: Pivot = key(
        LEFT_OUT,
        "for tables in long format, a row for each time and sensor: the columns of the sensors' names and values; "
        "each sensor becomes a column, and rows are put in order of time",
    )

    @model_validator(mode="after")
    def _separators_differ(self) -> Self:
        if self.thousands is not None and self.thousands == self.decimal:
            raise disagree(f"found '{self.thousands}'", "the decimal separator is another", "thousands")
        return self


class SplitSettings(Settings):
    """Which pieces train, which validate and which test."""

    by: Literal["random", "time", "quantity", "file", "column"] = key(
        "random",
        "random = pieces are drawn at random, by seed; time = the beginning of each trajectory is for training, its "
        "end for testing; quantity = pieces with low values are for training, those with high values for testing; "
        "file, column = as the names of the files or the values of a column say",
    )
    pieces: Literal["segments", "trajectories"] = key(
        "segments",
        "for random and quantity: segments = pieces as long as a chunk; trajectories = whole trajectories, but for "
        "random of two: one is for training, the other's halves for validation and test",
    )
    train_share: Share = key(0.6, "share of the pieces, or of each trajectory's points, in the training set")
    validation_share: Share = key(0.2, "the same for validation")
    test_share: Share = key(0.2, "the same for test; the three sum to 1")
    seed: Seed = key(0, "for random: the seed of the draw")
    reverse: bool = key(
        False,
        "for time: the end is for training and the beginning for testing; for quantity: high values are for training",
    )
    quantity: str = key(
        LEFT_OUT,
        "for quantity: an arithmetic expression in components of the state (in their units) and other columns, such "
        "as omega**2 / 2 - 1.4 * cos(theta), with abs, sqrt, exp, log, sin, cos, tan, tanh, arctan2, hypot, sign, "
        "minimum, maximum and pi",
    )
    statistic: Literal["mean", "max", "min", "range"] = key(
        "mean", "for quantity: which statistic of a piece's values counts"
    )
    thresholds: Pair = key(
        LEFT_OUT,
        "for quantity: pieces up to the first threshold are for training, those beyond the second for testing; left "
        "out = by the shares",
    )
    column: str = key(LEFT_OUT, "for column: its name; the value in a piece's rows assigns the set")
    train: Texts = key(LEFT_OUT, "for file: names or globs, for column: values, of the training set; left out = train")
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
        texts = getattr(self, split)
        return [split] if texts is None else [texts] if isinstance(texts, str) else list(texts)


class MeasurementSettings(Cutting, TableKeys):
    """Measurements of your own, in tables."""

    WHERE: ClassVar[str] = "data.files"

    paths: Texts = key(..., "files or globs: CSV (also .txt, .tsv, .dat), Parquet or NPZ; the files are never changed")
    checksums: str | None = key(None, "file with their SHA-256 checksums, as sha256sum writes it; null = not checked")
    time: Named = key("t", "the column of times: its name, or name, unit, factor and offset")
    date: str = key(
        LEFT_OUT, "the column of dates where times of day stand in one of their own; both together are the times"
    )
    time_format: str = key(
        LEFT_OUT,
        "how dates and times are written, as Python's strptime says it: '%d.%m.%Y %H:%M:%S', or '%M:%S' for minutes "
        "and seconds; left out = ISO dates, dates of whose day or month one is above 12 somewhere, and h:mm:ss",
        min_length=2,
    )
    trajectory: str | None = key(
        None, "the column that tells the trajectories in a file apart; null = each file is one"
    )
    columns: Annotated[dict[str, Named], Field(min_length=1)] = key(
        ..., "component of the state → its column; components without a column count as not measured"
    )
    inputs: dict[str, Named] = key(
        dict,
        "known input or covariate of a driven system → its column; a chunk lacking any of their values is left out",
    )
    z_e: dict[str, Annotated[Annotated[str, ONE] | Annotated[Label, KEYS], by_shape]] = key(
        dict,
        "expert parameter → the column that holds it (cells may be empty), or start: COMPONENT, that component's "
        "value at a chunk's first point; the other parameters are unknown",
    )
    angles: list[str] = key(
        list,
        "components that are angles and may jump by whole turns: they are unwrapped, and each chunk begins within "
        "half a turn",
    )
    unordered: Literal["refuse", "sort"] = key("refuse", "rows with times that go back: refuse them, or sort them")
    duplicates: Literal["refuse", "first", "mean"] = key(
        "refuse",
        "rows with the same time that differ: refuse them, or take the first or the mean; identical rows count once",
    )
    step_s: Positive | None = key(
        None,
        "time between consecutive points of a chunk, a multiple of the time between rows where uneven is mask; "
        "null = the time between rows",
        "s",
    )
    tolerance: Share = key(0.1, "how far a row's time may lie off the grid of points, as a share of the rows' step")
    uneven: Literal["mask", "interpolate", "own"] = key(
        "mask",
        "mask = rows lie on a grid of times, and points without a row count as not measured; interpolate = cubic "
        "splines through the rows, with their error given in splits.json; own = rows keep their times: they lie on a "
        "finer grid with points step_s apart (left out = a tenth of the usual time between rows), and lengths and "
        "strides count the points of that grid",
    )
    longest_gap: int = key(5, "consecutive missing points that a chunk may span; a longer gap ends it", ge=0, le=MANY)
    min_seen: Share = key(
        0.7,
        "share of a chunk's values, over the components with a column, that must have been measured; at 1, with a "
        "column for each component, models may rely on windows without gaps",
    )
    whole: bool = key(
        False,
        "each trajectory is one chunk, from its first row on, and what a shorter one lacks counts as not measured, "
        "however long its gaps: for few rows at uneven times; strides, longest_gap and min_seen then say nothing",
    )
    split: SplitSettings = key(SplitSettings, "which pieces are for training, validation and testing")

    @model_validator(mode="after")
    def _whole_ones_are_not_divided(self) -> Self:
        if self.whole and self.split.by == "time":
            raise disagree("time divides trajectories", "with whole give random, quantity, file or column", "split.by")
        if self.whole and self.horizons_s:
            remedy = "with whole give a larger length, or []"
            raise disagree("no chunk is longer than a trajectory", remedy, "horizons_s")
        return self

    @model_validator(mode="after")
    def _horizons_are_longer(self) -> Self:
        if self.step_s is not None:
            self.check_horizons(self.step_s)
        return self

    @property
    def files(self) -> list[str]:
        return [self.paths] if isinstance(self.paths, str) else list(self.paths)

    def of_files(self, files: Sequence[Path]) -> Self:
        """The same settings of these files."""
        return self.model_copy(update={"paths": [str(file) for file in files]})


class CutMeasurementsJob(Settings):
    """Job of the stage cut_measurements."""

    WHERE: ClassVar[str] = "--settings"

    system: dict[str, Any] = key(..., "name and arguments of the system, which says what its components are called")
    files: MeasurementSettings = key(..., "how the measurements are read, cut and divided")


class CutMeasuredHorizonJob(CutMeasurementsJob):
    """Job of the stage cut_measured_horizon."""

    set: str = key(..., "which of the sets that files.horizons_s names")

    @model_validator(mode="after")
    def _set_is_one_of_them(self) -> Self:
        if self.set not in self.files.horizons:
            raise disagree(f"found '{self.set}'", f"files.horizons_s makes {', '.join(self.files.horizons)}", "set")
        return self


def column_of(named: str | Column) -> Column:
    """A column from either way of writing it."""
    return Column(name=named) if isinstance(named, str) else named


def label_of(named: str | Label) -> Label:
    """A label from either way of writing it."""
    return Label(name=named) if isinstance(named, str) else named
