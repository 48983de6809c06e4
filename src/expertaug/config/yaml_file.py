"""Reading one YAML file of the configuration: strictly, in little time and memory, with each key's line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from expertaug.errors import InputError

LARGEST = 2**20  # bytes of a file
MOST = 100_000  # values of a file, those that an alias repeats counted each time
DEEPEST = 40  # levels of mappings and lists


class Located(dict):
    """A mapping that knows where its values were said.

    Attributes:
        origin: a text by key, ``file:line``.
        removed: keys whose null stands in the place of something else.
    """

    def __init__(self, values: Mapping | None = None, origin: Mapping[str, str] | None = None) -> None:
        super().__init__(values or {})
        self.origin: dict[str, str] = dict(origin or {})
        self.removed: frozenset[str] = frozenset()


# Written as the mapping that it is.
yaml.SafeDumper.add_representer(Located, yaml.SafeDumper.represent_dict)


def read(path: str | Path) -> Located:
    """The mapping that a file holds.

    Raises:
        InputError: the file is missing, too large, not YAML empty or no mapping, or a key stands in it twice.
    """
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(LARGEST + 1)
    except (OSError, ValueError) as error:
        said = getattr(error, "strerror", None) or error
        raise InputError(path, f"cannot be read ({said})", "give a configuration file") from error
    if len(data) > LARGEST:
        raise InputError(path, f"more than {LARGEST} bytes", "give a configuration file")
    try:
        text = data.decode("utf-8-sig")
        _check_brackets(text, path)
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        if root is not None:
            _check(root, path)
        value = None if root is None else _Reader(str(path)).construct_document(root)
    except RecursionError as error:
        raise _deep(path) from error
    except UnicodeDecodeError as error:
        raise InputError(path, f"is not text in UTF-8 ({error.reason})", "save it as UTF-8") from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else path
        raise InputError(
            where, f"not YAML ({getattr(error, 'problem', None) or error})", "correct that line"
        ) from error
    if value is None:
        raise InputError(path, "holds no keys", "write what it is to override, or leave the file out")
    if not isinstance(value, Located):
        raise InputError(f"{path}:1", f"found a {type(value).__name__}", "a configuration is a mapping of keys")
    return value


def _deep(path: object) -> InputError:
    return InputError(path, f"nested more than {DEEPEST} levels deep", "a configuration is not that deep")


def _check_brackets(text: str, path: object) -> None:
    """Refuse what PyYAML would take minutes for: its time grows with the square of the open brackets."""
    depth = 0
    for bracket in re.findall(r"[\[\]{}]", text):
        depth += 1 if bracket in "[{" else -1
        if depth > 10 * DEEPEST:
            raise _deep(path)


def _check(root: yaml.Node, path: object) -> None:
    """Refuse keys that are there twice, and what would grow without end: recursive, deep or repeated nodes."""
    sizes: dict[int, tuple[int, int]] = {}
    above: set[int] = set()

    def measure(node: yaml.Node, depth: int) -> tuple[int, int]:
        """Values in a node, and levels below it."""
        where = f"{path}:{node.start_mark.line + 1}"
        if id(node) in above:
            raise InputError(where, "an anchor that holds itself", "remove its alias")
        if depth > DEEPEST:
            raise _deep(where)
        if id(node) not in sizes:
            above.add(id(node))
            inside = node.value if isinstance(node, yaml.SequenceNode) else []
            if isinstance(node, yaml.MappingNode):
                _refuse_twice(node, path)
                inside = [part for pair in node.value for part in pair]
            total, levels = 1, 0
            for part in inside:
                values, below = measure(part, depth + 1)
                total, levels = total + values, max(levels, below + 1)
                if total > MOST:
                    raise InputError(where, f"more than {MOST} values", "a configuration has fewer")
            sizes[id(node)] = total, levels
            above.discard(id(node))
        if depth + sizes[id(node)][1] > DEEPEST:
            raise _deep(where)
        return sizes[id(node)]

    measure(root, 0)


def _refuse_twice(node: yaml.MappingNode, path: object) -> None:
    seen: dict[str, int] = {}
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise InputError(f"{path}:{key.start_mark.line + 1}", "a key that is no text", "name it by a text")
        line = key.start_mark.line + 1
        if key.value in seen:
            raise InputError(
                f"{path}:{line}", f"'{key.value}' is there twice, first in line {seen[key.value]}", "keep one of them"
            )
        seen[key.value] = line


class _Reader(yaml.constructor.SafeConstructor):
    """Makes mappings that know their lines; keys are texts."""

    def __init__(self, path: str) -> None:
        super().__init__()
        self.path = path

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, OverflowError) as error:
            said = "a number of too many digits" if "digits" in str(error) else str(error)
            raise yaml.constructor.ConstructorError(None, None, said, node.start_mark) from error

    def construct_yaml_map(self, node: yaml.MappingNode) -> Any:
        self.flatten_mapping(node)
        mapping = Located()
        yield mapping
        for key, value in node.value:
            mapping[key.value] = self.construct_object(value, deep=True)
            mapping.origin[key.value] = f"{self.path}:{key.start_mark.line + 1}"


_Reader.add_constructor("tag:yaml.org,2002:map", _Reader.construct_yaml_map)  # type: ignore[arg-type]
