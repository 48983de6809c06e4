"""Settings as typed models: the one source of a key's type, default, range, unit and description.

A stage's settings, the blocks of the configuration and the options of the package's own classes are subclasses of
:class:`Settings`.  The configuration, its JSON schema and its reference are made from them; what is wrong with a
mapping is said in one line for each mistake (:func:`read`, :func:`check`).  No numerical library is loaded here.
"""

import types
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias, TypeVar, Union, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    JsonValue,
    Tag,
    ValidationError,
    model_serializer,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError, core_schema

from expertaug import wording
from expertaug.errors import InputError, InputErrors

T = TypeVar("T", bound="Settings")
Raw: TypeAlias = Mapping[str, JsonValue]  # what a JSON or YAML file holds, not yet checked
MANY = 2**31 - 1  # what counts something is at most this
LARGEST = 3.4028235e38  # of float32
OWN = "own"  # in the place of the ranges of p⁺ that are to be found
LEFT_OUT: Any = object()
ONE, LIST, KEYS = Tag("@one"), Tag("@list"), Tag("@keys")


class Settings(BaseModel):
    """The base of all settings: unknown keys are refused, true is no number, nor is NaN, and nothing can be changed.

    Attributes:
        WHERE: how messages call these settings where they are read on their own.
        RENAMED: former names of keys, and what to write instead.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
    WHERE: ClassVar[str] = "settings"
    RENAMED: ClassVar[Mapping[str, str]] = {}

    @classmethod
    def from_mapping(cls, settings: Mapping[str, object] | Self | None, where: str | None = None) -> Self:
        """Settings from a mapping; what is left out keeps its default.

        Raises:
            InputError: a key is unknown or a value cannot be used.
        """
        return read(cls, settings, where)

    @classmethod
    def of(cls, **settings: object) -> Self:
        """Settings by name.

        Raises:
            InputError: as :meth:`from_mapping`.
        """
        return read(cls, settings)

    def to_json(self) -> dict[str, Any]:
        """What a JSON file holds of them: lists, mappings and scalars; keys that were left out are missing."""
        return self.model_dump(mode="json")

    def dump(self, include: Collection[str] | None = None, exclude: Collection[str] = ()) -> dict[str, Any]:
        """What JSON holds of the keys that were given or completed, of part of a block without its defaults."""
        keys = None if include is None else set(include)
        return self.model_dump(mode="json", exclude_unset=True, include=keys, exclude=set(exclude) or None)

    @classmethod
    def completed(cls, settings: Mapping[str, object]) -> Self:
        """Settings from a mapping, with their defaults as if they had been given.

        Raises:
            ValidationError: a key is unknown or a value cannot be used.
        """
        return cls.model_validate(cls.model_validate(settings).to_json())

    @model_serializer(mode="wrap")
    def _without_what_is_left_out(self, handler: Any) -> dict[str, object] | None:
        """Keys that have no default are missing, not null, where they are not given."""
        if not isinstance(self, Settings):  # a block that is left out itself
            return None
        dumped = handler(self)
        return {k: v for k, v in dumped.items() if k in self.model_fields_set or not is_left_out(type(self), k)}


def key(default: Any, description: str, unit: str = "", **limits: Any) -> Any:
    """A key of settings.

    Arguments:
        default: ... where it must be given, :data:`LEFT_OUT` where it may be left out.
        description: one line.
        unit: SI text, empty for a pure number.
        limits: as of :func:`pydantic.Field`.
    """
    extra: dict[str, Any] = {"unit": unit} if unit else {}
    if default is LEFT_OUT:
        return Field(default=None, description=description, json_schema_extra={**extra, "left_out": True}, **limits)
    made = {"default_factory": default} if callable(default) else {"default": default}
    return Field(**made, description=description, json_schema_extra=extra or None, **limits)


def is_left_out(kind: type[BaseModel], name: str) -> bool:
    """Whether a key has no value at all where it is not given."""
    field = kind.model_fields.get(name)
    extra = field.json_schema_extra if field is not None else None
    return isinstance(extra, Mapping) and bool(extra.get("left_out"))


def wrong(problem: str, remedy: str, at: str = "") -> PydanticCustomError:
    """What a validator of a value raises: what was found, what would be right; ``at`` names a key inside the value."""
    return PydanticCustomError("wrong", "{found}; {remedy}", {"found": problem, "remedy": remedy, "at": at})


def disagree(problem: str, remedy: str, at: str = "") -> PydanticCustomError:
    """What a validator of several keys raises, which cannot judge a part of them; ``at`` names one of the keys."""
    return PydanticCustomError("disagree", "{found}; {remedy}", {"found": problem, "remedy": remedy, "at": at})


def agreement(check: Callable[[Any], Iterable[PydanticCustomError]]) -> Any:
    """A validator of a whole block that yields what of its keys disagrees (:func:`disagree`): all of it is told."""

    def validate(block: Any) -> Any:
        complaints = [error.context or {} for error in check(block)]
        if complaints:
            raise PydanticCustomError("disagree", "{found}; {remedy}", complaints[0] | {"further": complaints[1:]})
        return block

    return model_validator(mode="after")(validate)


def _each_once(values: list[int]) -> list[int]:
    for k, value in enumerate(values):
        if value in values[:k]:
            raise wrong(f"{value} is there twice", "give each once", f"[{k}]")
    return values


def _check_order(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise wrong(f"found {wording.show(list(value))}", "min must not exceed max")
    if max(map(abs, value)) > LARGEST:
        raise wrong(f"found {wording.show(list(value))}", f"numbers up to {LARGEST:.3g} can be computed with")
    return value


def _speak(value: object) -> str:
    """Whether a value that is a number or a word is meant as the number, also where YAML takes that for a text."""
    return "@word" if isinstance(value, str) and wording.number_in(value) is None else "@number"


def _shape(value: object) -> str:
    return "@keys" if isinstance(value, Mapping | BaseModel) else "@list" if isinstance(value, list | tuple) else "@one"


# A value that may be written in several ways: as one scalar, a list or a mapping of keys.
by_shape = Discriminator(_shape)


@dataclass(frozen=True)
class ByName:
    """A text that is one of the names that are known when it is read, or names a class, ``package.module:Class``.

    Attributes:
        names: the known ones.
    """

    names: Callable[[], Collection[str]]

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_after_validator_function(self._known, handler(source))

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {"anyOf": [{"enum": list(self.names()), "type": "string"}, {"pattern": ":", "type": "string"}]}

    def _known(self, value: str) -> str:
        if ":" not in value and value not in self.names():
            choices = ", ".join(f"'{name}'" for name in self.names())
            raise PydanticCustomError("literal_error", "is none of {expected}", {"expected": choices})
        return value


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1, le=MANY)]
Seed = Annotated[int, Field(ge=0, lt=2**32)]
Pair = Annotated[tuple[float, float], Field(strict=False)]
PositivePair = Annotated[tuple[Positive, Positive], Field(strict=False)]
Range = Annotated[
    tuple[float, float], Field(strict=False, json_schema_extra={"ordered": True}), AfterValidator(_check_order)
]
EachOnce = AfterValidator(_each_once)  # of a list
Name = Annotated[str, Field(pattern=wording.PATTERNS["name"])]
Seeds = Annotated[list[Annotated[int, Field(ge=0, lt=2**63)]], Field(min_length=1), EachOnce]
Device = Literal["auto", "cpu", "cuda"]
# Standard deviation of the noise of data: of every value, of each component's, or as estimated from measurements.
_NoiseOfAll = Annotated[
    Annotated[NotNegative, Tag("@number")] | Annotated[Literal["estimated"], Tag("@word")], Discriminator(_speak)
]
Noise = Annotated[Annotated[_NoiseOfAll, ONE] | Annotated[dict[str, NotNegative], KEYS], by_shape]
Prior = Annotated[Annotated[Literal["own"], ONE] | Annotated[dict[str, Range], KEYS], by_shape]


def given_ranges(prior: object) -> dict[str, tuple[float, float]]:
    """The ranges of a :data:`Prior`.

    Raises:
        InputError: they are still to be found.
    """
    if not isinstance(prior, dict):
        raise InputError("--prior", "missing", "p⁺ is to find its own ranges: give what own-prior wrote")
    return prior


def read(kind: type[T], settings: Mapping[str, object] | T | None, where: str | None = None) -> T:
    """Settings of a kind from a mapping; what is left out keeps its default.

    Raises:
        InputErrors: everything that is wrong; the message is the first one's.
    """
    if isinstance(settings, kind):
        return settings
    where = kind.WHERE if where is None else where
    if settings is not None and not isinstance(settings, Mapping):
        raise InputError(where, f"found {wording.show(settings)}", "give a mapping of keys")
    try:
        return kind.model_validate(dict(settings or {}))
    except ValidationError as error:
        raise InputErrors(complaints(error, kind, where)) from None


def check(kind: type[BaseModel], settings: object, where: str, whole: bool = True) -> list[InputError]:
    """Everything that is wrong with settings of a kind.

    Arguments:
        where: path of the block, for the messages; empty for the whole configuration.
        whole: whether keys that are not there count, and keys that disagree.
    """
    try:
        kind.model_validate(settings)
    except ValidationError as error:
        return complaints(error, kind, where, whole)
    return []


def complaints(error: ValidationError, kind: type[BaseModel], where: str, whole: bool = True) -> list[InputError]:
    """One line for each mistake of a validation, in the order of their blocks."""
    by_text = {}
    every = error.errors(include_url=False)
    for mistake in sorted(every, key=_place):
        if mistake["type"] == "too_short":  # what is wrong is not there in pydantic's count
            deep = len(mistake["loc"])
            if any(len(other["loc"]) > deep and other["loc"][:deep] == mistake["loc"] for other in every):
                continue
        of_a_part = mistake["type"] == "disagree" or (
            mistake["type"] == "missing" and isinstance(mistake["loc"][-1], str)
        )
        if of_a_part and not whole:
            continue
        context = mistake.get("ctx", {})
        for each in (context, *context.get("further", ())):
            said = wording.explain({**mistake, "ctx": each}, where, lambda path: _describe(kind, path))
            by_text.setdefault(str(said), said)
    return list(by_text.values())


def _place(error: ErrorDetails) -> list[str]:
    """By which mistakes are ordered: a key that is unknown or missing is one of its block."""
    of_block = error["type"] in ("missing", "extra_forbidden")
    return [str(part) for part in (error["loc"][:-1] if of_block else error["loc"])]


def _describe(kind: Any, path: Sequence[str | int]) -> wording.Described:
    """What is known of the place ``path`` in settings: its type, description and keys."""
    annotation, description = kind, ""
    for part in path:
        annotation = _plain(annotation, part)
        if isinstance(part, str) and part.startswith("@"):
            continue
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            field = annotation.model_fields.get(str(part))
            if field is None:
                return wording.Described()
            annotation, description = field.annotation, field.description or ""
        else:
            inside = [a for a in get_args(annotation) if a is not Ellipsis]
            annotation = inside[-1] if inside else Any
    null = type(None) in get_args(annotation)
    plain = _plain(annotation, None)
    model = plain if isinstance(plain, type) and issubclass(plain, BaseModel) else None
    keys = {n: f.description or "" for n, f in model.model_fields.items()} if model else {}
    renamed = getattr(model, "RENAMED", {}) if model else {}
    return wording.Described(keys, renamed, description, null, _shapes(annotation))


def _members(annotation: Any) -> list[Any]:
    if get_origin(annotation) in (Union, types.UnionType):
        return [a for a in get_args(annotation) if a is not type(None)]
    return [annotation]


def _plain(annotation: Any, part: object) -> Any:
    """A type without what is wrapped round it; of several shapes the one whose tag is ``part``."""
    while get_origin(annotation) is Annotated or get_origin(annotation) in (Union, types.UnionType):
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
            continue
        inside = _members(annotation)
        if len(inside) > 1:
            tagged = [a for a in inside if any(isinstance(m, Tag) and m.tag == part for m in get_args(a)[1:])]
            if not tagged:
                return annotation
            inside = tagged
        annotation = inside[0]
    return annotation


def _shapes(annotation: Any) -> Iterable[str]:
    """Words for the shapes that a value of several shapes may have."""
    words = {"@one": "one value", "@list": "a list", "@keys": "a mapping of keys"}
    for member in _members(_plain(annotation, None)):
        for tag in get_args(member)[1:]:
            if isinstance(tag, Tag):
                yield words[tag.tag]
