"""The rule graph of a run, laid out in layers from top to bottom (Sugiyama, Tagawa and Toda 1981)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from graphlib import TopologicalSorter
from itertools import pairwise
from statistics import fmean

LETTER, PADDING, GAP = 6.7, 16.0, 16.0  # px: of a character's width, of a box around its text, between two boxes
WIDEST = 1150.0  # px: of a layer, where rules that nothing reads from can go further down
HIGH, STEP, MARGIN = 26.0, 62.0, 4.0  # px: of a box, from one layer to the next, around the drawing
SWEEPS = 8  # over the layers, each of which sorts them by their neighbours


@dataclass(frozen=True)
class Box:
    """A rule: its name, the middle of its box and its width, in px."""

    name: str
    x: float
    y: float
    width: float


@dataclass(frozen=True)
class Drawing:
    """Boxes of one height, the arrows between them as paths of SVG, and the size of the whole, in px."""

    boxes: list[Box]
    paths: list[str]
    width: float
    height: float
    box_height: float = HIGH


@dataclass(frozen=True, order=True)
class _Node:
    """A rule, or, where an arrow passes a layer, its place there."""

    name: str
    passes: tuple[str, int] | tuple[()] = ()

    @property
    def width(self) -> float:
        return GAP if self.passes else LETTER * len(self.name) + PADDING


def drawing(arrows: Iterable[Sequence[str]]) -> Drawing:
    """Lay out arrows (rule, rule that reads what it makes); an arrow that follows from others is left out."""
    before: dict[str, set[str]] = {}
    for source, reader in sorted(map(tuple, arrows)):
        before.setdefault(source, set())
        before.setdefault(reader, set()).add(source)
    if not before:
        return Drawing([], [], 0.0, 0.0)
    order = list(TopologicalSorter(before).static_order())
    direct = _reduce(before, order)
    level: dict[str, int] = {}
    for name in order:
        level[name] = max((level[rule] + 1 for rule in direct[name]), default=0)
    for name in reversed(order):  # what others alone need stands close above them
        if readers := [level[rule] for rule in order if name in direct[rule]]:
            level[name] = min(readers) - 1
    _fold(level, {name for name in order if not any(name in sources for sources in direct.values())})
    ways = [_way(source, reader, level) for reader in order for source in sorted(direct[reader])]
    layers = _sort(level, ways)
    width = max(sum(node.width + GAP for node in layer) for layer in layers)
    x, boxes = {}, []
    for depth, layer in enumerate(layers):
        right = (width - sum(node.width + GAP for node in layer)) / 2
        for node in layer:
            x[node] = MARGIN + right + (node.width + GAP) / 2
            right += node.width + GAP
            if not node.passes:
                boxes.append(Box(node.name, x[node], _y(depth), node.width))
    paths = [_path([(x[node], _y(depth)) for node, depth in way]) for way in ways]
    return Drawing(boxes, paths, width + 2 * MARGIN, _y(len(layers) - 1) + HIGH / 2 + MARGIN)


def _reduce(before: dict[str, set[str]], order: Sequence[str]) -> dict[str, set[str]]:
    """What each reads that nothing else it reads has read already."""
    all_before: dict[str, set[str]] = {}
    for name in order:
        all_before[name] = before[name].union(*(all_before[rule] for rule in before[name]))
    return {
        name: {a for a in sources if not any(a in all_before[b] for b in sources)} for name, sources in before.items()
    }


def _fold(level: dict[str, int], last: set[str]) -> None:
    """Move rules that nothing reads from down, from layers that are too wide."""
    depth = 0
    while depth <= max(level.values()):
        room = WIDEST
        for name in sorted(level, key=lambda rule: (rule in last, rule)):
            if level[name] == depth:
                room -= _Node(name).width + GAP
                if room < 0 and name in last:
                    level[name] += 1
        depth += 1


def _way(source: str, reader: str, level: dict[str, int]) -> list[tuple[_Node, int]]:
    between = range(level[source] + 1, level[reader])
    inner = [(_Node(source, (reader, depth)), depth) for depth in between]
    return [(_Node(source), level[source]), *inner, (_Node(reader), level[reader])]


def _sort(level: dict[str, int], ways: Sequence[Sequence[tuple[_Node, int]]]) -> list[list[_Node]]:
    """The nodes of each layer, in an order that lets few arrows cross: by the mean place of their neighbours."""
    layers: list[list[_Node]] = [[] for _ in range(max(level.values()) + 1)]
    above: dict[_Node, list[_Node]] = {}
    below: dict[_Node, list[_Node]] = {}
    for node, depth in sorted({(_Node(name), depth) for name, depth in level.items()} | {n for w in ways for n in w}):
        layers[depth].append(node)
    for way in ways:
        for (previous, _), (next_, _) in pairwise(way):
            below.setdefault(previous, []).append(next_)
            above.setdefault(next_, []).append(previous)
    for sweep in range(SWEEPS):
        down = sweep % 2 == 0
        for layer in layers if down else reversed(layers):
            neighbours = above if down else below
            place = {node: (k + 0.5) / len(each) for each in layers for k, node in enumerate(each)}
            layer.sort(key=lambda node: fmean([place[neighbour] for neighbour in neighbours.get(node, [node])]))
    return layers


def _y(depth: int) -> float:
    return MARGIN + HIGH / 2 + STEP * depth


def _path(points: Sequence[tuple[float, float]]) -> str:
    """From below the first box to above the last, vertical at each layer."""
    (x, y), *rest = points
    y += HIGH / 2
    text = f"M{x:.1f} {y:.1f}"
    for k, (to_x, to_y) in enumerate(rest):
        end = to_y - HIGH / 2
        middle = (y + end) / 2
        text += f"C{x:.1f} {middle:.1f} {to_x:.1f} {middle:.1f} {to_x:.1f} {end:.1f}"
        x, y = to_x, end
        if k < len(rest) - 1:
            text += f"V{to_y + HIGH / 2:.1f}"
            y = to_y + HIGH / 2
    return text
