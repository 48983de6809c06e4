"""The configuration that uses inspected measurements, as YAML that is valid as it stands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import yaml

from expertaug.errors import InputError
from expertaug.measurements.cut import chunks_of
from expertaug.measurements.inspect import Inspection
from expertaug.measurements.settings import MeasurementSettings

LONGEST, SHORTEST, PIECES = 200, 8, 8  # points of a chunk; chunks that a trajectory should have where there are few
FEW = 10  # trajectories below which each is cut into several pieces
NAME = "measured"


def proposal(found: Inspection, system: Mapping | None, priors: Mapping[str, list[float]]) -> str:
    """YAML for the experiment ``measured``.

    Arguments:
        system: its name and arguments; None: NAME stands for it, to be replaced.
        priors: a first guess of the range of each expert parameter.
    """
    settings, length, counts = _cut(found)
    t1_s = round(length // 2 * found.data.grid.step_s, 9)
    given = {
        k: v
        for k, v in settings.items()
        if k in ("names", "decimal", "time", "trajectory", "unordered", "duplicates", "uneven")
    }
    files = {
        "paths": settings["paths"] if len(settings["paths"]) > 1 else settings["paths"][0],
        **given,
        "columns": settings["columns"],
        **{k: settings[k] for k in ("length", "stride", "evaluation_stride", "min_chunks", "split")},
    }
    state = found.names.state
    unseen = [name for name in state if name not in settings["columns"]]
    start = {name: _guessed(found) for name in unseen}
    prior = {name: [float(f"{end:.6g}") for end in ends] for name, ends in priors.items()}
    blocks = [
        f"# expertaug validate FILE; snakemake --cores 2 --configfile FILE   ({_told(counts)})",
        "results: results/measured",
        f"run: [{NAME}]",
        "experiments:",
        f"  {NAME}:",
        f"    system: {_flow(system or {'name': 'NAME'})}"
        + ("" if system else "  # a module of yours, as mysystems.oscillator"),
        "    data:",
        "      source: files",
        f"      t1_s: {t1_s:.12g}  # end of the observed window",
        "      noise: estimated",
    ]
    if start:
        blocks.append(f"      start: {_flow(start)}  # nobody measured these: say between what they begin")
    blocks.append("      files:")
    blocks += [f"        {key}: {_flow(value)}" for key, value in files.items()]
    windows = {name: [0.0, t1_s] for name in settings["columns"]}
    blocks += [
        "    model:",
        f"      encoder: {{kind: window, windows: {_flow(windows)}, layers: [64, 64], latent: 1, activation: silu}}",
        "      interaction: {kind: mlp, layers: [32, 32], activation: silu}",
        "    training:",
        "      {epochs: 200, batch_size: 20, learning_rate: 3.0e-3, horizon_warmup: 0.3, objective: {lambda0: 100.0}}",
    ]
    if prior or system is None:
        shown = _flow(prior) if prior else "{PARAMETER: [0.1, 10.0]}"
        blocks += [
            f"    augmentation: {{prior: {shown}}}  # p+: between what the expert's parameters may lie",
            "    finetuning: {epochs: 100, batch_size: 20, learning_rate: 3.0e-3}",
        ]
    blocks += [
        "    methods: [mean, least_squares, aphynity]",
        "    augmented: [aphynity]",
        "    evaluation: {from_s: null}",
    ]
    return "\n".join(blocks) + "\n"


def _cut(found: Inspection) -> tuple[dict, int, dict[str, int]]:
    """Settings whose three sets have chunks: as long as the data allow."""
    settings = _plain(found.settings)
    series = found.data.grid.series
    points = sorted(int(one.usable.sum()) for one in series)
    several = len(series) >= FEW
    length = points[len(points) // 10] if several else points[-1] // PIECES
    split = {"by": "random", "pieces": "trajectories"} if several else {"by": "time"}
    length = int(np.clip(length, SHORTEST, LONGEST))
    while True:
        stride = max(1, length // 8)
        own = {"length": length, "stride": stride, "evaluation_stride": max(1, length // 2), "min_chunks": 1}
        settings |= own | {"split": split}
        try:
            rows = chunks_of(replace(found.data, settings=MeasurementSettings.from_mapping(settings)))[0]
        except InputError:
            if length <= 3:
                raise
            length = max(3, length // 2)
            continue
        return settings, length, {name: len(of) for name, of in rows.items()}


def _plain(settings: MeasurementSettings) -> dict:
    """Settings as they would be written: what is not the default, columns by name where that is all."""
    dumped = settings.model_dump(mode="json", exclude_defaults=True)
    paths = dumped["paths"]
    dumped["paths"] = [paths] if isinstance(paths, str) else paths

    def short(column: object) -> object:
        if not isinstance(column, Mapping):
            return column
        kept = {k: v for k, v in column.items() if v not in (None, 1.0, 0.0)}
        return kept["name"] if list(kept) == ["name"] else kept

    dumped["columns"] = {name: short(column) for name, column in dumped["columns"].items()}
    if "time" in dumped:
        dumped["time"] = short(dumped["time"])
    return dumped


def _guessed(found: Inspection) -> list[float]:
    """A range for what nobody measured: twice the largest rate of a measured component."""
    rates = [np.abs(np.diff(one.rows.y, axis=0) / np.diff(one.rows.t)[:, None]) for one in found.data.grid.series]
    pooled = np.concatenate(rates)
    pooled = pooled[np.isfinite(pooled)]
    size = float(f"{2 * np.quantile(pooled, 0.99):.2g}") if len(pooled) else 1.0
    return [-size, size]


def _told(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in counts.items()) + " chunks"


def _flow(value: object) -> str:
    """A value on one line of YAML."""
    text = yaml.safe_dump(value, default_flow_style=True, width=10**6, sort_keys=False, allow_unicode=True).strip()
    return text.removesuffix("\n...").strip()
