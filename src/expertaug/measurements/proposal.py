"""The configuration that uses inspected measurements, as YAML that is valid as it stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import yaml

from expertaug.errors import InputError, printable
from expertaug.measurements.cut import Measured, chunks_of, measure
from expertaug.measurements.inspect import SPARSE, Inspection
from expertaug.measurements.sensors import rows_of_a_period
from expertaug.measurements.settings import MeasurementSettings
from expertaug.settings import MANY

LONGEST, SHORTEST, LEAST = 200, 8, 3  # points of a chunk, and of one where the data allow no longer one
PIECES = 8  # chunks that a trajectory should have where there are few
FINEST = 400  # points of a chunk whose rows keep their times
FEW, FEWEST = 10, 3  # trajectories for a split between them, without a caution and with one
OF_A_PERIOD = 40  # points, where rows are so dense that a chunk would end within one
OBSERVED = 2 / 3  # of those rows, in the observed window
NEAREST, STEPS = 0.1, 2  # the quantile of times from row to row that has so many of a solver's steps
NAME = "measured"
# Keys of data.files that are shown where they are not the default, before the columns.
READING = (
    *("names", "separator", "decimal", "thousands", "skip_lines", "missing", "beside", "pivot", "time", "date"),
    *("time_format", "trajectory", "angles", "unordered", "duplicates", "uneven", "step_s", "tolerance"),
    *("longest_gap", "min_seen"),
)
# How the test set of a split is called in tables and figures, and what it is.
TESTS = {
    "time": ("test (later)", "the test set is the end of each trajectory: the same motion later, not another one"),
    "trajectories": (
        "test (other trajectories)",
        "the test set is other trajectories of the same kind, drawn at random",
    ),
    "halves": (
        "test (another trajectory)",
        "one of the two trajectories, each too short for a split by time, trains; the other's first half validates and "
        "its second half tests: scores depend on it alone",
    ),
}
BETWEEN = {"by": "random", "pieces": "trajectories"}


def proposal(
    inspection: Inspection, system: Mapping | None, priors: Mapping[str, Sequence[float]], constants: Sequence[str] = ()
) -> str:
    """YAML for the experiment ``measured``.

    Arguments:
        system: its name and arguments; None: NAME stands for it, to be replaced.
        priors: a first guess of the range of each expert parameter.
        constants: expert parameters that all windows of one apparatus share.
    """
    settings, cut, rows = _cut(inspection)
    length, several = cut.settings.length, len(inspection.data.grid.series)
    t1_s = _t1_s(settings, length, inspection)
    files = {
        "paths": settings["paths"] if len(settings["paths"]) > 1 else settings["paths"][0],
        **{k: _marks(settings[k]) if k == "missing" else settings[k] for k in READING if k in settings},
        "columns": settings["columns"],
        **{
            k: settings[k]
            for k in ("inputs", "whole", "length", "phases", "stride", "evaluation_stride")
            if k in settings
        },
        **{k: settings[k] for k in ("min_chunks", "split")},
    }
    split = "time" if settings["split"] != BETWEEN else "trajectories" if several >= FEWEST else "halves"
    remarks = {"split": TESTS[split][1]}
    if split == "trajectories" and several < FEW:
        each = {name: len(np.unique(of[:, 0])) for name, of in rows.items()}
        counted = f"{each['validation']} for validation, {each['test']} for the test"
        remarks["split"] += f"; there are only {several}: {counted}, on which scores depend"
    if "whole" in settings:
        remarks["whole"] = "a trajectory is a chunk, from its first row on: it has few rows"
    if "phases" in settings:
        remarks["step_s"] = "chunks of successive rows would end within a swing"
    unseen = [name for name in inspection.names.state if name not in settings["columns"]]
    start = {name: _guess(inspection) for name in unseen}
    prior = {name: [float(f"{end:.6g}") for end in ends] for name, ends in priors.items()}
    # Windows share constants of the apparatus; what gives the first point is each window's own.
    sharing = bool(constants) or system is None
    fitted = ["least_squares", *(["least_squares_shared"] if sharing else [])]
    one_apparatus = sharing and len(inspection.data.grid.series) < FEWEST  # else an encoder reads a trajectory's own
    learned = ["ml_only", "aphynity", *(["aphynity_shared"] if one_apparatus else [])]
    learned += ["alternating", *(["alternating_shared"] if sharing else [])]
    methods = ["mean", "expert_only", *fitted, *learned]
    training = {"epochs": 200, "batch_size": 20, "learning_rate": 3e-3, "horizon_warmup": 0.3, "expert_first": 0.2}
    training |= _solver(settings, inspection)
    blocks = [
        *(comment(said) for said in (cut.told_rates(), cut.told_late(rows.values()), cut.told_short()) if said),
        f"# next: expertaug validate FILE; snakemake --cores 2 --configfile FILE   ({_count(rows)})",
        "results: results/measured",
        f"run: [{NAME}]",
        "experiments:",
        f"  {NAME}:",
        f"    system: {flow(system or {'name': 'NAME'})}"
        + ("" if system else "  # a module of yours, such as mysystems.oscillator"),
        "    data:",
        "      source: files",
        f"      t1_s: {t1_s:.12g}  # end of the observed window",
        f"      noise: {flow(_noise(inspection))}",
    ]
    if start:
        blocks.append(f"      start: {flow(start)}  # not measured: give the range of the first values")
    blocks.append("      files:")
    blocks += [
        f"        {key}: {flow(value)}" + (f"  # {remarks[key]}" if remarks.get(key) else "")
        for key, value in files.items()
    ]
    windows = {name: [0.0, t1_s] for name in settings["columns"]}
    blocks += [
        "    model:",
        f"      encoder: {{kind: window, windows: {flow(windows)}, layers: [64, 64], latent: 1, activation: silu}}",
        "      interaction: {kind: mlp, layers: [32, 32], activation: silu}",
        f"    training: {flow(training | {'objective': {'lambda0': 100.0}})}",
    ]
    if prior or system is None:
        shown = flow(prior) if prior else "{PARAMETER: [0.1, 10.0]}"
        blocks += [
            f"    augmentation: {{prior: {shown}}}  # p+: the range in which the expert's parameters may lie",
            "    finetuning: {epochs: 100, batch_size: 20, learning_rate: 3.0e-3}",
        ]
    overrides: dict[str, object] = {"ml_only": {"training": {"expert_first": 0.0}}}
    if sharing:
        overrides["alternating_shared"] = {"alternation": {"latent": 0}}  # what it learns is one apparatus's too
        blocks += _sharing(inspection, constants or ["PARAMETER"])
    blocks += [
        f"    overrides: {flow(overrides)}",
        f"    methods: {flow(methods)}",
        "    augmented: [aphynity]",
        "    controls: [aphynity]",
        "    refined: [aphynity, aphynity+]",
        f"    evaluation: {flow({'from_s': None, 'set_titles': {'test': TESTS[split][0]}})}",
    ]
    return "\n".join(blocks) + "\n"


def _t1_s(settings: Mapping, length: int, inspection: Inspection) -> float:
    """The end of the observed window: the middle of a chunk, or, of few rows, the time of the first two thirds."""
    row_s = inspection.data.grid.row_s
    if "whole" in settings:
        since = np.concatenate([of.rows.t - of.rows.t[0] for of in inspection.data.grid.series])
        return round(int(np.clip(np.quantile(since, OBSERVED, method="higher") / row_s, 1, length - 2)) * row_s, 9)
    return round(length // 2 * row_s * _points_apart(settings, inspection), 9)


def _solver(settings: Mapping, inspection: Inspection) -> dict[str, dict]:
    """Steps as far apart as rows are whose grid is finer; none where inputs bend at each point of it."""
    if settings.get("uneven") != "own" or set(inspection.names.inputs) - inspection.names.constant:
        return {}
    apart = np.concatenate([np.diff(of.rows.t) for of in inspection.data.grid.series])
    points = int(np.quantile(apart, NEAREST) / inspection.data.grid.row_s / STEPS)
    return {"solver": {"method": "rk4", "points_per_step": points}} if points > 1 else {}


def _sharing(inspection: Inspection, constants: Sequence[str]) -> list[str]:
    """What windows share: of one or two trajectories a value for all, of more a value each, which may be the same.  Of
    three of them one trains, which has no distribution."""
    scales = {mismatch.rate: {"scale": "shared"} for mismatch in inspection.slopes if mismatch.may_be_scale}
    sensors = [f"      sensors: {flow(scales)}"] if scales else []
    if len(inspection.data.grid.series) < FEWEST:
        units = flow(dict.fromkeys(constants, "shared"))
        remark = "one value for all windows of one apparatus; if there are several, write window"
        return ["    refinement:", f"      units: {units}  # {remark}", *sensors]
    units, population = (flow(dict.fromkeys(constants, word)) for word in ("trajectory", "normal"))
    blocks = ["    refinement:", f"      units: {units}  # one value each; if all are of one apparatus, write shared"]
    if len(inspection.data.grid.series) > FEWEST:
        blocks.append(f"      population: {population}  # of these values; narrow where trajectories hardly differ")
    return blocks + sensors


def _marks(values: Sequence[float | str]) -> list[float | str]:
    whole = [isinstance(mark, float) and mark.is_integer() and abs(mark) < 1e15 for mark in values]
    return [int(mark) if is_whole else mark for mark, is_whole in zip(values, whole, strict=True)]


def _noise(inspection: Inspection) -> str | dict[str, float]:
    """The key ``noise``: estimated, unless a sensor's resolution is coarser than that."""
    if not np.isfinite(inspection.resolution).any():
        return "estimated"
    names = [name for name in inspection.names.state if name in inspection.settings.columns]
    places = {name: list(inspection.names.state).index(name) for name in names}
    return {name: float(f"{np.nan_to_num(inspection.noise[k]):.3g}") for name, k in places.items()}


def _points_apart(settings: Mapping, inspection: Inspection) -> int:
    """Points of the grid from one of a chunk's points to the next."""
    return round(settings["step_s"] / inspection.data.grid.row_s) if "phases" in settings else 1


def _cut(inspection: Inspection) -> tuple[dict, Measured, dict[str, np.ndarray]]:
    """Settings whose three sets have chunks, the data with these, and the chunks (N, 2): as long as the data allow,
    between trajectories where there are some, or where they are too short for a split by time."""
    settings, data = _plain(inspection.settings), inspection.data
    if (whole := _whole(settings, inspection)) is not None:
        return whole
    apart = _rows_apart(inspection)
    if apart > 1:
        settings |= {"step_s": float(f"{apart * data.grid.row_s:.9g}"), "phases": "first"}
        data = replace(data, grid=replace(data.grid, step=apart))
    series = data.grid.series
    points = sorted(int(trajectory.usable.sum()) // apart for trajectory in series)
    most = FINEST if settings.get("uneven") == "own" else LONGEST
    by_time = ({"by": "time"}, int(np.clip(points[-1] // PIECES, SHORTEST, most)))
    between = (BETWEEN, int(np.clip(points[len(points) // 10], SHORTEST, most)))
    tries, enough = [by_time], LEAST
    if len(series) >= FEWEST:
        tries = [between, by_time]
    elif len(series) == 2:
        tries, enough = [by_time, (BETWEEN, int(np.clip(points[0] // 2, LEAST, most)))], SHORTEST
    longest = problem = None
    for split, length in tries:
        cut = _longest(settings | {"split": split}, data, length)
        if isinstance(cut, InputError):
            problem = cut
        elif longest is None or cut[0]["length"] > longest[0]["length"]:
            longest = cut
        if longest is not None and longest[0]["length"] >= enough:
            break
    if longest is None:
        assert problem is not None
        raise problem
    return longest


def _whole(settings: dict, inspection: Inspection) -> tuple[dict, Measured, dict[str, np.ndarray]] | None:
    """The same where trajectories have few rows at uneven times, a chunk each; None where they have not."""
    series, row_s = inspection.data.grid.series, inspection.data.grid.row_s
    rows = [len(of.rows.t) for of in series]
    if settings.get("uneven") != "own" or len(series) < FEWEST or max(rows) > SPARSE or min(rows) < 2:
        return None
    points = max(round((of.rows.t[-1] - of.rows.t[0]) / row_s) for of in series) + 1
    if not SHORTEST <= points <= MANY:
        return None
    tried = settings | {"step_s": row_s, "whole": True, "length": points, "min_chunks": 1, "split": BETWEEN}
    for key in ("stride", "evaluation_stride"):  # which say nothing, but are at most the length
        del tried[key]
        if MeasurementSettings.model_fields[key].default > points:
            tried[key] = points
    try:
        cut = measure(MeasurementSettings.from_mapping(tried), inspection.names)
        return tried, cut, chunks_of(cut)[0]
    except InputError:  # what stands in its way, as inputs that end, is told of shorter chunks
        return None


def _longest(settings: dict, data: Measured, length: int) -> tuple[dict, Measured, dict[str, np.ndarray]] | InputError:
    """The same for the longest chunks up to a length that one way to split allows; what is wrong where none does."""
    problem = None
    while length >= LEAST:
        own = {"length": length, "stride": max(1, length // 8), "evaluation_stride": max(1, length // 2)}
        tried = settings | own | {"min_chunks": 1}
        cut = replace(data, settings=MeasurementSettings.from_mapping(tried))
        try:
            return tried, cut, chunks_of(cut)[0]
        except InputError as error:
            problem, length = error, length // 2 if length > 5 else length - 1
    assert problem is not None
    return problem


def _rows_apart(inspection: Inspection) -> int:
    """Every how many rows a chunk takes one: several where they are so dense that it would end within a swing."""
    if inspection.settings.uneven != "mask" or inspection.settings.step_s is not None:
        return 1
    series = inspection.data.grid.series
    components = [k for k, name in enumerate(inspection.names.state) if name in inspection.settings.columns]
    periods = [rows_of_a_period([trajectory.y[:, k] for trajectory in series]) for k in components]
    period = min((swing for swing in periods if swing is not None), default=None)
    if period is None or period <= LONGEST:
        return 1
    longest = max(int(trajectory.usable.sum()) for trajectory in series)
    return max(1, min(int(period / OF_A_PERIOD), longest // (SHORTEST * PIECES)))


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

    for key in {"columns", "inputs"} & dumped.keys():
        dumped[key] = {name: short(column) for name, column in dumped[key].items()}
    if "time" in dumped:
        dumped["time"] = short(dumped["time"])
    return dumped


def _guess(inspection: Inspection) -> list[float]:
    """A range for what nobody measured: twice the largest rate of a measured component."""
    rates = [
        np.abs(np.diff(trajectory.rows.y, axis=0) / np.diff(trajectory.rows.t)[:, None])
        for trajectory in inspection.data.grid.series
    ]
    pooled = np.concatenate(rates)
    pooled = pooled[np.isfinite(pooled)]
    size = float(f"{2 * np.quantile(pooled, 0.99):.2g}") if len(pooled) else 1.0
    return [-size, size]


def _count(rows: Mapping[str, np.ndarray]) -> str:
    return ", ".join(f"{len(of)} {name}" for name, of in rows.items()) + " chunks"


class _OneLine(yaml.SafeDumper):
    """Texts with line breaks or other signs that are not seen are written escaped, within double quotes."""


def _write(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if text.isprintable() else '"')


_OneLine.add_representer(str, _write)


def flow(value: object) -> str:
    """A value on one line of YAML, which reads back as the same."""
    options = {"default_flow_style": True, "width": float("inf"), "sort_keys": False, "allow_unicode": True}
    return yaml.dump(value, Dumper=_OneLine, **options).strip().removesuffix("\n...").strip()


def comment(line: str) -> str:
    """A line as a comment of YAML: what a file's names hold of line breaks and the like is escaped."""
    return f"# {printable(line)}"
