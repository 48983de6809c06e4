"""The run log, the truth about a run: JSON lines, typed, and read back as typed records.

The first line is a header that says what ran; each further line is either a step,
``{"step": 3, "time": 1.7e9, "loss": [0.1, 0.2]}`` with one value per seed (or one number for all of them; non-finite
values as the texts "nan", "inf", "-inf"), or an event (a dataset, an artifact, a seed that failed, the end).
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    FiniteFloat,
    JsonValue,
    Tag,
    TypeAdapter,
    ValidationError,
)

from expertaug.errors import InputError

Status = Literal["FINISHED", "FAILED", "KILLED"]


class Record(BaseModel):
    """A line of a log; keys that it does not know are left to later versions."""

    model_config = ConfigDict(frozen=True, extra="ignore")


class Run(Record):
    """A job that logs."""

    experiment: str
    method: str
    label: str
    system: str
    preset: str
    stage: str
    seeds: tuple[int, ...] = Field(
        description="trained together, in the order of every metric's values; empty: one run"
    )
    params: dict[str, Any] = Field(description="the settings, in any nesting that JSON holds")
    tags: dict[str, str] = Field({}, description="further texts for the store")


class Header(Run):
    """The first line: a run that was begun."""

    id: str
    time: FiniteFloat
    replaces: str | None = Field(None, description="the id of the log that lay at the same path before")

    @classmethod
    def begin(cls, run: Run, identity: str, replaces: str | None, tags: Mapping[str, str]) -> Header:
        """The header of a log that begins now; what JSON does not hold in its parameters becomes text."""
        params = json.loads(json.dumps(run.params, default=str), parse_constant=str)
        fields = run.model_dump() | {"params": params, "tags": tags | run.tags}
        return cls(id=identity, time=time.time(), replaces=replaces, **fields)


class Step(Record):
    """Metrics of one step: one value per seed, or one for all of them."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float | tuple[float, ...]] = Field(init=False)
    step: int = Field(ge=-(2**63), lt=2**63)
    time: FiniteFloat

    @property
    def metrics(self) -> Mapping[str, float | tuple[float, ...]]:
        return self.__pydantic_extra__


class Dataset(Record):
    """A file that the job reads as a data set; ``schema`` and ``profile`` as of :func:`describe_data`."""

    event: Literal["dataset"] = "dataset"
    name: str
    path: str = Field(description="relative to the log's folder")
    sha256: str
    tensors: dict[str, JsonValue] | None = Field(None, alias="schema")
    profile: dict[str, JsonValue] | None = None


class Artifact(Record):
    """An output file, in the log's folder or below."""

    event: Literal["artifact"] = "artifact"
    path: str = Field(description="relative to the log's folder")


class End(Record):
    """The last line of a log that was closed."""

    event: Literal["end"] = "end"
    time: FiniteFloat
    status: Status


class Event(Record):
    """Any other event, with fields of its own."""

    model_config = ConfigDict(extra="allow")
    event: str
    time: FiniteFloat | None = None  # version 0.1.0 wrote some without


def _kind(line: object) -> str:
    event = line.get("event") if isinstance(line, dict) else None
    return "step" if event is None else event if event in ("dataset", "artifact", "end") else "event"


Line = Step | Dataset | Artifact | End | Event
_TAGGED = Annotated[
    Annotated[Step, Tag("step")]
    | Annotated[Dataset, Tag("dataset")]
    | Annotated[Artifact, Tag("artifact")]
    | Annotated[End, Tag("end")]
    | Annotated[Event, Tag("event")],
    Discriminator(_kind),
]


@dataclass(frozen=True)
class Log:
    """What a run log holds: its header and every complete line after it, and their length in bytes."""

    header: Header
    lines: tuple[Line, ...] = ()
    size: int = 0

    @property
    def steps(self) -> list[Step]:
        """The lines that hold metrics."""
        return [line for line in self.lines if isinstance(line, Step)]


def read_log(path: str | Path) -> Log:
    """Read a run log; a last line that a kill left incomplete is ignored.

    Raises:
        InputError: the file is missing, is no run log, or a line inside it is broken.
    """
    lines, size = read_lines(path)
    header = lines[0] if lines else None
    if not isinstance(header, Header):
        raise InputError(path, "no line is complete", "make the log again with its stage")
    for row, line in enumerate(lines, 1):
        for name, values in line.metrics.items() if isinstance(line, Step) else ():
            if isinstance(values, tuple) and len(values) != len(header.seeds):
                problem = f"line {row}: {name} has {len(values)} values for {len(header.seeds)} seeds"
                raise InputError(path, problem, "make the log again with its stage")
    return Log(header, tuple(line for line in lines[1:] if not isinstance(line, Header)), size)


def read_lines(path: str | Path, offset: int = 0) -> tuple[list[Header | Line], int]:
    """The complete lines of a log from ``offset`` in bytes on, and where they end.

    Raises:
        InputError: as :func:`read_log` does.
    """
    try:
        with Path(path).open("rb") as stream:
            stream.seek(offset)
            texts = stream.read().split(b"\n")[:-1]
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "run the stage that makes it") from error
    lines = [_parse(path, row, text, first=offset == 0 and row == 1) for row, text in enumerate(texts, 1)]
    return lines, offset + sum(len(text) + 1 for text in texts)


def _parse(path: str | Path, row: int, text: bytes, first: bool) -> Header | Line:
    try:
        return _adapter(Header if first else _TAGGED).validate_json(text)
    except ValidationError as error:
        wrong = error.errors(include_url=False, include_input=False, include_context=False)[0]
        place, why = ".".join(str(part) for part in wrong["loc"]), wrong["msg"]
        if first and wrong["type"] == "missing":
            raise InputError(path, f"the header has no {place!r}", "give a log that a training wrote") from None
        problem = f"line {row} is not JSON" if wrong["type"] == "json_invalid" else f"line {row}: {place}: {why}"
        raise InputError(path, problem, "make the log again with its stage") from None


@cache
def _adapter(kind: Any) -> TypeAdapter:
    return TypeAdapter(kind)
