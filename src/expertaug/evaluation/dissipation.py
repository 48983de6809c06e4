"""The stage dissipation: the power that models of a pendulum dissipate, beside the measured loss of energy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, NullLocator, StrMethodFormatter
from torch import Tensor

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation.metrics import Metric
from expertaug.evaluation.settings import DissipationJob
from expertaug.evaluation.summary import order_sets
from expertaug.evaluation.table import DASH, Study, Table
from expertaug.inference.least_squares import refine_by, refinement_of
from expertaug.inference.shared import on_training_windows
from expertaug.models import store
from expertaug.models.decoder import Decoder
from expertaug.models.fit_settings import Refinement
from expertaug.models.posterior import Estimates
from expertaug.models.store import device_of
from expertaug.rows import frame, group_by
from expertaug.systems import System
from expertaug.systems.settings import CONSERVING
from expertaug.trajectories import SetFolder, Trajectories
from expertaug.versions import MAIN_SETS, Version
from expertaug.windows import Windows

CHUNKS = 1000  # of each set, evenly spread
CAPTION = (
    "Loss of mechanical energy E per inertia (of the first arm, where there are two), in s⁻³, on measured states. "
    "Measured: −dE/dt, the mean "
    "over chunks of the median slope of E (± its standard error, by recording). Dissipated: the mean of "
    "−∇E · (F_e + F_a) on the same states, mean ± standard deviation (n − 1) over seeds; an expert without friction "
    "conserves E, so this is the power that F_a dissipates. E has the constants of each method's own expert. "
    "Correlation: of the two over recordings."
)
TITLE = "loss of energy"
MEASURED = {"color": "0.4", "linewidth": 0.9, "zorder": 1}
WIDE = 3.0  # times the measured loss, above which an axis is no longer linear
THREE_DIGITS = Metric("dissipated", "dissipated")


def measured_loss(system: System, t: Tensor, states: Tensor, z_e: Tensor) -> Tensor:
    """−dE/dt of measured states: the median of the slopes between any two points (Theil and Sen).

    Arguments:
        t: times in s, (T,).
        states: (T, …, *state); NaN where nothing was measured: those points are left out.
        z_e: expert parameters (…, P) with which E is computed.

    Returns:
        (…,), NaN where fewer than two points were measured.
    """
    level = system.energy(states.double(), z_e.double())
    first, second = torch.triu_indices(len(t), len(t), offset=1)
    span = (t[second] - t[first]).view(-1, *[1] * (level.ndim - 1))
    return -((level[second] - level[first]) / span).nanmedian(0).values


def dissipated_power(decoder: Decoder, states: Tensor, estimates: Estimates | None) -> Tensor:
    """−∇E · (F_e + F_a), the mean over given states, with the constants of the decoder's own expert.

    Arguments:
        decoder: of a system with an energy, stacked over S seeds, or without parameters.
        states: (T, S, B, *state); nothing is forecast; NaN where nothing was measured.
        estimates: z_e and z_a (S, B, …) with which E, F_e and F_a are asked; not needed where there is no F_a and
            neither E nor F_e asks for z_e.

    Returns:
        (S, B) in E's unit per second.
    """
    system = decoder.system
    z_e = states.new_zeros(*states.shape[1:3], len(system.expert_parameters)) if estimates is None else estimates.z_e
    assert z_e is not None
    context = None
    if decoder.interaction is not None:
        assert estimates is not None
        context = decoder.context(estimates.z_a, z_e)
    powers = []
    for y in states:
        with torch.no_grad():
            rate = system.expert(states.new_zeros(()), y, z_e)
            if context is not None:
                rate = rate + decoder.interaction(y, context)  # type: ignore[misc]
        exact = y.double().requires_grad_()
        (gradient,) = torch.autograd.grad(system.energy(exact, z_e.double()).sum(), exact)
        powers.append(-(gradient * rate.double()).sum(-1))
    return torch.stack(powers).nanmean(0)


@dataclass(frozen=True)
class Loss:
    """Mean loss of energy of a recording's chunks in a set, as a model's expert has it.

    Attributes:
        experiment, method, label, seed, expert: of the model.
        set, recording, chunks: of which chunks, and how many of them were measured.
        measured, measured_se: −dE/dt, and its standard error over chunks.
        dissipated: by the model; NaN of a seed that could not be trained.
    """

    experiment: str
    method: str
    label: str
    seed: int
    expert: str
    set: str
    recording: str
    chunks: int
    measured: float
    measured_se: float
    dissipated: float


def run_stage(models: Sequence[Path], data: Path, outputs: Sequence[Path], job: DissipationJob) -> None:
    """Stage: write the tables and draw the figure.

    Arguments:
        models: model files of every version that is trained, and of all groups of seeds.
        data: folder of train.npz, validation.npz and test.npz.
        outputs: any of .csv (a row for each version, seed, set and recording), .md, .tex, .png and .pdf.

    Raises:
        InputError: a file is broken, as of :func:`dissipation`, or an output's suffix is unknown.
    """
    trained = (store.load(path, device_of(job.device), job.classes or ()) for path in models)
    dissipation(trained, SetFolder(data), job).save(outputs)


def dissipation(models: Iterable[store.StoredModel], sets: Mapping[str, Trajectories], job: DissipationJob) -> Study:
    """The tables and the figure.

    Arguments:
        models: of every version that is trained, and of all groups of seeds.
        sets: train, validation and test.

    Raises:
        InputError: a model is of another system or of no version, or a version has no model.
    """
    device, chunks = device_of(job.device), {name: sets[name].spread(CHUNKS) for name in MAIN_SETS}
    of_methods = _by_method(models, job)
    losses: list[Loss] = []
    for version, label, refinement in job.versions:
        for stored in of_methods[str(Version.parse(version).trained)]:
            losses += _losses(stored, refinement, chunks, device, (job.experiment, version, label))
    return Study(frame(Loss, losses), tables(losses, job), lambda: draw(losses, job), precision="%.7g")


def _by_method(models: Iterable[store.StoredModel], job: DissipationJob) -> dict[str, list[store.StoredModel]]:
    """Models by the version that they were trained as."""
    wanted = list(dict.fromkeys(str(Version.parse(version).trained) for version, *_ in job.versions))
    of_methods: dict[str, list[store.StoredModel]] = {name: [] for name in wanted}
    for stored in models:
        card = stored.card
        if card.system_name not in CONSERVING:
            raise InputError(stored.where, f"a model of {card.system_name}", f"give one of {', '.join(CONSERVING)}")
        if card.method not in of_methods:
            raise InputError(stored.where, f"a model of '{card.method}'", f"give those of {', '.join(wanted)}")
        of_methods[card.method].append(stored)
    if missing := [name for name in wanted if not of_methods[name]]:
        raise InputError(missing[0], "no model of this version", "give a model of every version")
    return of_methods


def _losses(
    stored: store.StoredModel,
    refinement: Refinement | None,
    sets: Mapping[str, Trajectories],
    device: torch.device,
    whose: tuple[str, str, str],
) -> list[Loss]:
    """Of every seed on every set and recording; ``whose``: experiment, method and label."""
    fitting = refinement_of(stored, refinement)
    decoder = getattr(stored.model, "decoder", stored.model)
    estimator = stored.model
    if fitting is not None:
        if refinement is not None:
            fitting = on_training_windows(stored, fitting, sets["train"])
        estimator = refine_by(stored, fitting)
    observed, rows = stored.card.observed, []
    # Where z_e is the start, neither E nor F_e asks for it.
    asks = decoder.interaction is not None or type(decoder.system).initial_state is System.initial_state
    for name, chunks in sets.items():
        windows = Windows.of(chunks, device).expand(len(stored.seeds))
        states = windows.y
        with torch.no_grad():
            estimates = estimator.estimate(windows.until(observed)) if asks else None
        power = dissipated_power(decoder, states, estimates).cpu().numpy()
        z_e = states.new_zeros(len(stored.seeds), len(chunks), 1) if estimates is None else estimates.z_e
        assert z_e is not None
        measured = measured_loss(decoder.system, torch.from_numpy(chunks.t).to(device), states, z_e).cpu().numpy()
        own = recordings_of(chunks)
        for recording in dict.fromkeys(own):
            inside = own == recording
            for seed, of_seed, lost in zip(stored.seeds, power[:, inside], measured[:, inside], strict=True):
                finite = np.isfinite(lost)
                error = lost[finite].std() / np.sqrt(finite.sum())
                power_of_seed = np.nan if seed in stored.failed else of_seed[finite].mean()
                numbers = int(finite.sum()), float(lost[finite].mean()), float(error), float(power_of_seed)
                rows.append(Loss(*whose, seed, stored.card.system.get("expert", ""), name, str(recording), *numbers))
    return rows


def recordings_of(chunks: Trajectories) -> np.ndarray:
    """The recording of each chunk, (N,): ids are recording/first frame; one for all where there are none."""
    return np.full(len(chunks), "all") if chunks.trajectories is None else chunks.trajectories


def tables(losses: Sequence[Loss], job: DissipationJob) -> list[Table]:
    """A table of methods and one of recordings."""
    (head, rows), (second, by_recording) = _of_methods(losses, job), _of_recordings(losses, job)
    name = job.experiment
    label, title = f"{name}-dissipation".replace("_", "-"), f"{name}: {TITLE}"
    first = Table(head, [("", rows)], 2, (), title, CAPTION, label)
    return [first, Table(second, [("", by_recording)], 2, caption="By recording:")]


def over_recordings(losses: Sequence[Loss]) -> tuple[float, float, float]:
    """Measured and dissipated loss of one seed on one set, means over chunks of all recordings; and their correlation
    over recordings, NaN of fewer than three."""
    chunks, measured, dissipated = np.array([(loss.chunks, loss.measured, loss.dissipated) for loss in losses]).T
    weights = chunks / chunks.sum()
    varied = len(losses) > 2 and np.isfinite(dissipated).all() and dissipated.std() > 0
    correlation = float(np.corrcoef(measured, dissipated)[0, 1]) if varied else np.nan
    return float(np.nansum(weights * measured)), float((weights * dissipated).sum()), correlation


def _of_methods(losses: Sequence[Loss], job: DissipationJob) -> tuple[list[str], list[list[str]]]:
    """A row for each set and version."""
    rows = []
    for name in order_sets(loss.set for loss in losses):
        for version, label, _ in job.versions:
            own = [loss for loss in losses if (loss.set, loss.method) == (name, version)]
            means = map(over_recordings, group_by(own, lambda loss: loss.seed).values())
            measured, dissipated, correlations = zip(*means, strict=True)
            cells = [_text(measured[:1]), _text(dissipated), _text(correlations)]
            rows.append([job.of_set(name), label, *(cell.replace("-", "−") for cell in cells)])
    return ["set", "method", "measured", "dissipated", "correlation"], rows


def _of_recordings(losses: Sequence[Loss], job: DissipationJob) -> tuple[list[str], list[list[str]]]:
    """A row for each set and recording, a column for each expert's measured loss and each version."""
    experts = list(dict.fromkeys(loss.expert for loss in losses))
    rows = []
    for (name, recording), part in group_by(losses, lambda loss: (loss.set, loss.recording)).items():
        firsts = [next(loss for loss in part if loss.expert == expert) for expert in experts]
        measured = [_number(loss.measured, loss.measured_se) for loss in firsts]
        each = [_text([loss.dissipated for loss in part if loss.method == version]) for version, *_ in job.versions]
        cells = [cell.replace("-", "−") for cell in (*measured, *each)]
        rows.append([job.of_set(name), recording, str(firsts[0].chunks), *cells])
    columns = ["measured"] if len(experts) == 1 else [f"measured, {expert}" for expert in experts]
    return ["set", "recording", "chunks", *columns, *(label for _, label, _ in job.versions)], rows


def _text(values: Sequence[float]) -> str:
    """Mean ± standard deviation over the seeds that have a value."""
    valid = np.array([value for value in values if not np.isnan(value)])
    if not len(valid):
        return DASH
    text = _number(valid.mean(), valid.std(ddof=1) if len(valid) > 1 else None)
    return text + (f" ({len(valid)}/{len(values)})" if len(valid) < len(values) else "")


def _number(mean: float, spread: float | None) -> str:
    """Three digits of a mean, and its spread as exactly."""
    text = THREE_DIGITS.format(mean)
    return text(mean) if spread is None else f"{text(mean)} ± {text(spread)}"


def draw(losses: Sequence[Loss], job: DissipationJob) -> Figure:
    """What models dissipate, a point for each seed, beside the measured loss, all as means over chunks: a panel for
    each expert and set, a row for each of the expert's versions."""
    experts, sets = list(dict.fromkeys(loss.expert for loss in losses)), order_sets(loss.set for loss in losses)
    labels = {version: label for version, label, _ in job.versions}
    colours = plotting.colours(list(labels), dict(job.hues))
    own = {e: [v for v in labels if any((o.expert, o.method) == (e, v) for o in losses)] for e in experts}
    counts = [len(of_expert) for of_expert in own.values()]
    with plotting.use_style():
        figure = plotting.new_figure(0.5 + 0.75 * len(experts) + 0.19 * sum(counts))
        panels = figure.subplots(
            len(experts), len(sets), squeeze=False, sharey="row", gridspec_kw={"height_ratios": counts}
        )
        for row, (expert, versions) in zip(panels, own.items(), strict=True):
            for axis, name in zip(row, sets, strict=True):
                part = [loss for loss in losses if (loss.expert, loss.set) == (expert, name)]
                measured, error = _measured(part)
                axis.axvspan(measured - 2 * error, measured + 2 * error, color="0.9", linewidth=0, zorder=0)
                axis.axvline(measured, **MEASURED)
                dissipated: list[float] = []
                for place, version in enumerate(versions):
                    seeds = group_by((loss for loss in part if loss.method == version), lambda loss: loss.seed)
                    x = [over_recordings(of_seed)[1] for of_seed in seeds.values()]
                    look = plotting.look(version, colours, 3.2) | {"linestyle": "none"}
                    axis.plot(x, [place] * len(x), **look)
                    dissipated += x
                _scale(axis, abs(measured), dissipated)
                axis.set_ylim(len(versions) - 0.4, -0.6)
                title = job.of_set(name)
                axis.set_title(title if len(experts) == 1 else f"{title},\nexpert {expert.replace('_', ' ')}")
                axis.grid(axis="x")
            row[0].set_yticks(range(len(versions)), [labels[version] for version in versions])
            row[len(sets) // 2].set_xlabel("dissipated by the model [s⁻³]")
        shade = Patch(color="0.9", label="± 2 standard errors")
        plotting.legend(figure, [Line2D([], [], label="measured loss", **MEASURED), shade])
        plotting.heading(figure, f"{job.of_experiment(job.experiment)}: loss of energy per inertia")
    return figure


def _measured(losses: Sequence[Loss]) -> tuple[float, float]:
    """The mean over chunks of all recordings of a set, and its standard error: the median over versions and seeds, as E
    has constants that each estimates."""
    each = []
    for of_one in group_by(losses, lambda loss: (loss.method, loss.seed)).values():
        chunks, errors = (np.array([getattr(loss, name) for loss in of_one]) for name in ("chunks", "measured_se"))
        each.append((over_recordings(of_one)[0], np.sqrt(np.nansum((chunks / chunks.sum() * errors) ** 2))))
    measured, error = np.nanmedian(np.array(each), axis=0)
    return float(measured), float(error)


def _scale(axis: Axes, measured: float, dissipated: Sequence[float]) -> None:
    """From zero, linear as far as the measured loss goes; beyond logarithmic where a model dissipates many times
    that."""
    finite = np.abs([value for value in dissipated if np.isfinite(value)])
    axis.axvline(0.0, color="0.75", linewidth=0.6, zorder=0)
    if len(finite) and np.isfinite(measured) and 0 < WIDE * measured < finite.max():
        end, beyond = float(f"{measured:.1g}"), 10.0 ** np.ceil(np.log10(finite.max()))
        axis.set_xscale("symlog", linthresh=measured, linscale=2.0)
        axis.set_xticks([-beyond, -end, 0.0, end, beyond])
        axis.set_xlim(-1.5 * beyond if min(dissipated) < 0 else -0.1 * end, 1.5 * beyond)
        axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.xaxis.set_minor_locator(NullLocator())
    else:
        axis.xaxis.set_major_locator(MaxNLocator(3))
