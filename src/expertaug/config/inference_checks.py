"""Checks of what a configuration says of controls, flows, refined versions and least squares."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from expertaug.config.methods import FITTED
from expertaug.config.names import unknown, unknown_one
from expertaug.config.options import KnownSystem
from expertaug.errors import InputError
from expertaug.versions import FLOW, Version, base


def check(where: str, one: Mapping, methods: Mapping, known: KnownSystem | None) -> Iterator[InputError]:
    """What is wrong with the keys controls, flows, refined and refinement of a completed experiment.

    Versions of methods that the experiment does not train are no mistake: an override may take a method away.
    """
    remedies = {
        "controls": "only hybrid methods can be trained on",
        "flows": "only methods of kind hybrid and alternating have a posterior",
    }
    allowed = {"controls": ("hybrid",), "flows": ("hybrid", "alternating")}
    for block, needed in (("controls", ("finetuning",)), ("flows", ())):
        yield from unknown(one[block], methods, f"{where}.{block}", "method")
        for k, method in enumerate(one[block]):
            kind = _kind(methods, method)
            if kind not in allowed[block]:
                yield InputError(f"{where}.{block}[{k}]", f"'{method}' is of kind {kind}", remedies[block])
        for key in needed:
            if set(one[block]) & set(one["methods"]) and key not in one:
                yield InputError(f"{where}.{key}", "missing", f"methods under {block} need it")
    yield from _refined(f"{where}.refined", one["refined"], methods)
    fitted = [m for m in one["methods"] if _kind(methods, m) in FITTED]
    for method in fitted:
        own = one["overrides"].get(method, {}).get("refinement") or {}
        if not own.get("starts", one["refinement"]["starts"]):
            at = f"overrides.{method}.refinement.starts" if "starts" in own else "refinement.starts"
            yield InputError(f"{where}.{at}", "found 0", f"{method} has no other starts: give 1 or more")
            break
    for k, method in enumerate(one["methods"]):
        if methods.get(method, {}).get("truth") and one["data"]["source"] != "simulation":
            found = f"'{method}' takes the equation that made the data"
            yield InputError(f"{where}.methods[{k}]", found, "only simulated data have one: leave it out")
    windows = one["refinement"].get("windows", {})
    if known is not None and known.state is not None:
        yield from unknown(windows, known.state, f"{where}.refinement.windows", "component of the state")


def _refined(where: str, variants: list[str], methods: Mapping) -> Iterator[InputError]:
    for k, variant in enumerate(variants):
        here, kind = f"{where}[{k}]", _kind(methods, base(variant))
        yield from unknown_one(base(variant), methods, here, "method")
        if Version.parse(variant).estimators not in ((), (FLOW,)):
            yield InputError(here, f"found '{variant}'", "name the version that is to be refined, as METHOD+")
        elif variant in variants[:k]:
            yield InputError(here, f"'{variant}' is there twice", "name each version once")
        elif kind == "mean":
            yield InputError(here, f"'{variant}' is of kind mean", "name a version with an expert")
        elif kind in FITTED and FLOW not in Version.parse(variant).estimators:
            yield InputError(here, f"'{variant}' is of kind {kind}", "it is fitted to each window already")


def _kind(methods: Mapping, method: str) -> str:
    return methods.get(method, {}).get("kind", "hybrid")
