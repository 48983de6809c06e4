"""What a system with events leaves no choice of: solvers that stop at them, and methods whose expert knows them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from expertaug.errors import InputError
from expertaug.systems.settings import EVENTS

TRAINED = ("hybrid", "alternating")
BLOCKS = ("training", "finetuning", "refinement", "flow", "alternation", "evaluation")
SOLVERS = ("solver", "draws_solver")


def check(where: str, one: Mapping, methods: Mapping, jumps: bool) -> Iterator[InputError]:
    """What is wrong with a completed experiment whose system has events; ``jumps``: what is observed jumps there."""
    blocks = {f"{where}.{name}": one.get(name) for name in BLOCKS}
    for method, over in one["overrides"].items():
        blocks |= {f"{where}.overrides.{method}.{name}": over.get(name) for name in BLOCKS}
    for at, block in blocks.items():
        for key in SOLVERS:
            solver = (block or {}).get(key)
            if solver is not None and solver.get("method", EVENTS) != EVENTS:
                found = f"'{solver['method']}' steps over the system's events"
                yield InputError(f"{at}.{key}.method", found, f"give {EVENTS}, with substeps")
    for k, method in enumerate(one["methods"]):
        if methods.get(method, {}).get("expert") is False:
            found = f"'{method}' has no expert, who alone knows the system's events"
            yield InputError(f"{where}.methods[{k}]", found, "leave it out")
        elif jumps and methods.get(method, {}).get("kind") in TRAINED:
            found = f"'{method}' is trained by gradients, and what the system observes jumps at its events"
            yield InputError(
                f"{where}.methods[{k}]", found, "take a method of kind least_squares, or observe what does not"
            )
