"""Where the paper and the authors' code disagree, and what each preset does.

One row of :class:`Choices` is one choice: its meaning and the value under each preset.  ``paper`` follows the text,
``code`` the authors' release as it behaves, ``corrected`` (the default) what this project takes for right.  An
experiment's ``choices`` override single rows; whatever is listed here is what the stages obey.  What is simulated is no
choice of a stage: the shipped experiments say it in their ``presets``, and :data:`SIMULATED` tells it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

from pydantic.fields import FieldInfo

from expertaug.errors import InputError
from expertaug.settings import LEFT_OUT, Settings, key
from expertaug.wording import suggest

Preset = Literal["paper", "code", "corrected"]
NAMES: tuple[Preset, ...] = get_args(Preset)


@dataclass(frozen=True)
class Row:
    """One choice: what it decides, what it may be, and its value under each preset."""

    meaning: str
    values: tuple[str, ...]
    paper: str
    code: str
    corrected: str


def _row(meaning: str, *, paper: str, code: str, corrected: str) -> Any:
    """A row of the table: what it decides, and its value under each preset."""
    field = key(LEFT_OUT, meaning)
    field.json_schema_extra |= {"presets": {"paper": paper, "code": code, "corrected": corrected}}
    return field


class Choices(Settings):
    """The table: a row is a key; those that a stage does not obey may be left out of what it is given."""

    WHERE: ClassVar[str] = "choices"

    loss_window: Literal["observed", "half_batch"] = _row(
        "points of a trajectory that enter the loss where data.t1_s limits it: observed = [t0, t1] only; half_batch = "
        "all of [t0, t2] for half of each batch (the authors' slip: the forecast leaks)",
        paper="observed",
        code="half_batch",
        corrected="observed",
    )
    observed_points: Literal["inclusive", "exclusive"] = _row(
        "whether the observed window includes the point at t1 (51 points at 0.1 s and 5 s) or stops before it (50)",
        paper="inclusive",
        code="exclusive",
        corrected="inclusive",
    )
    multiplier: Literal["lagrangian", "fixed"] = _row(
        "the multiplier of the Lagrangian: lagrangian = raised by tau2 times the data term at regular intervals of "
        "passes; fixed = stays at its first value",
        paper="lagrangian",
        code="fixed",
        corrected="lagrangian",
    )
    penalty: Literal["rms", "rms_mixed", "norm_data"] = _row(
        "size of F_a in the loss: rms = root mean square along the predicted trajectory; rms_mixed = the same with "
        "each component of the state taken from a different window and time, since the angle and the speed of a "
        "decaying swing are correlated, and the smallest F_a that damps it contains a share of the restoring force; "
        "norm_data = mean Euclidean norm on the states of the data",
        paper="rms",
        code="norm_data",
        corrected="rms",
    )
    loss_normalisation: Literal["none", "first"] = _row(
        "whether the data term is divided by its first value, taken over the full loss window",
        paper="none",
        code="first",
        corrected="none",
    )
    noise: Literal["config", "none"] = _row(
        "standard deviation of the observation noise of simulated sets: config = data.noise, none = 0",
        paper="none",
        code="config",
        corrected="config",
    )
    frozen: Literal["interaction", "interaction_and_z_e_head"] = _row(
        "what fine-tuning leaves unchanged: interaction = F_a only; interaction_and_z_e_head = also the encoder's z_e "
        "head",
        paper="interaction",
        code="interaction_and_z_e_head",
        corrected="interaction",
    )
    resample: Literal["once", "epoch"] = _row(
        "whether augmented samples are drawn once, or anew for every pass",
        paper="once",
        code="once",
        corrected="once",
    )
    augmentation_noise: Literal["as_data", "none"] = _row(
        "whether augmented samples get the noise of the data",
        paper="none",
        code="none",
        corrected="as_data",
    )
    augmented_x: Literal["data", "resampled"] = _row(
        "x of augmented samples: data = the sample's own; resampled = drawn anew where the system can do so (the "
        "double pendulum's two angles), as in the authors' code",
        paper="data",
        code="resampled",
        corrected="data",
    )
    augmented_z_a: Literal["posterior", "prior"] = _row(
        "z_a of augmented samples: posterior = drawn from q(z_a | x, y), the paper's Algorithm 1; prior = from N(0, "
        "I) where the posterior is not a point estimate, as the paper's appendix says of the hybrid-VAE and the "
        "release does",
        paper="posterior",
        code="prior",
        corrected="posterior",
    )
    hvae_z_e: Literal["sampled", "mean"] = _row(
        "the hybrid-VAE's z_e in training: sampled = a sample from q(z_e | x, y); mean = its mean, without a "
        "divergence (the authors' pendulum)",
        paper="sampled",
        code="mean",
        corrected="sampled",
    )
    supervision: Literal["standardised", "raw", "off"] = _row(
        "the z_e term of augmented samples: standardised = Gaussian log-density with z_e in units of p+'s standard "
        "deviation; raw = squared error in the parameter's own unit; off = none",
        paper="standardised",
        code="raw",
        corrected="standardised",
    )
    z_a_supervision: Literal["weighted", "off"] = _row(
        "whether z_a of augmented samples, which is known since it was drawn, is supervised as z_e is: weighted = by "
        "finetuning.z_a_supervision_weight, where an experiment gives one; off = never, as in paper and release",
        paper="off",
        code="off",
        corrected="weighted",
    )
    forecast_start: Literal["y0", "y_t1"] = _row(
        "the state from which the forecast is integrated: y0, or y_t1 (the last observed point)",
        paper="y0",
        code="y0",
        corrected="y0",
    )
    selection: Literal["observed", "forecast"] = _row(
        "points of the validation set by which the best model is chosen: observed = [t0, t1], forecast = (t1, t2]",
        paper="observed",
        code="forecast",
        corrected="observed",
    )
    augmented_selection: Literal["observed", "forecast"] = _row(
        "points of the augmented validation samples by which fine-tuning selects, beside the validation set: observed "
        "= those that training compares; forecast = (t1, t2], where the model itself made them: an encoder whose z_a "
        "leave the range in which F_a was learned explains the observed window and fails after it",
        paper="observed",
        code="observed",
        corrected="observed",
    )


def _describe(field: FieldInfo) -> Row:
    assert isinstance(field.json_schema_extra, dict)
    return Row(field.description or "", get_args(field.annotation), **field.json_schema_extra["presets"])  # type: ignore[arg-type]


ROWS: Mapping[str, Row] = {name: _describe(field) for name, field in Choices.model_fields.items()}


@dataclass(frozen=True)
class Simulated:
    """What a shipped experiment simulates under each preset, and why they differ.

    Attributes:
        experiment, key: where its values stand; ``config/experiments`` says them.
        meaning: what they are and why.
    """

    experiment: str
    key: str
    meaning: str
    paper: object
    code: object
    corrected: object


SIMULATED = (
    Simulated(
        "rlc",
        "system.equations",
        "three circuits, which differ in what the resistance adds to dI/dt: additive = −(R/C) I, the paper's F_a as "
        "printed; code = −R I / (L C), what the release simulates; kirchhoff = −R I / L, the one that obeys "
        "V = U + R I + L dI/dt",
        paper="additive",
        code="code",
        corrected="kirchhoff",
    ),
    Simulated(
        "rlc",
        "system.source_rad_s",
        "ω of the source V(t) = 2.5 sin(ω t) + 1: the paper prints 4π, which steps of 0.1 s sample five times per "
        "period; the release has 2, which produced the published numbers",
        paper=12.566370614359172,
        code=2.0,
        corrected=2.0,
    ),
    Simulated(
        "rlc",
        "data.sets.train.size",
        "number of samples in the circuit's training set; the other sets have 1,000 samples in the release, 100 in "
        "the paper",
        paper=2000,
        code=3000,
        corrected=2000,
    ),
    Simulated(
        "reaction_diffusion",
        "data.sets.test.z_e.b",
        "range of b in the test set: the paper prints 0.1 as its upper end, the release 0.01; p+ ends at 0.01 in both, "
        "so that 0.1 is taken for a slip: nine tenths of that test set would lie outside the augmented range",
        paper=[0.001, 0.1],
        code=[0.001, 0.01],
        corrected=[0.001, 0.01],
    ),
    Simulated(
        "reaction_diffusion",
        "system.reaction",
        "what the expert knows of the local reaction: false = nothing (diffusion alone, the paper's text); "
        "without_k = all but its constant k (the release, and so the published numbers; diffusion alone has its own "
        "rows)",
        paper=False,
        code="without_k",
        corrected="without_k",
    ),
    Simulated(
        "pendulum_shift",
        "data.sets.train.z_a.alpha",
        "range of friction on which the study of friction shifts is trained: [0, 0.3] in the paper, [0, 0.6] "
        "everywhere in the release",
        paper=[0.0, 0.3],
        code=[0.0, 0.6],
        corrected=[0.0, 0.3],
    ),
)


def wrong_choice(choices: Mapping[str, object]) -> tuple[str, str, str] | None:
    """The first row that does not exist, or not with its value: the row, what was found, what would be right."""
    for name, value in choices.items():
        if name not in ROWS:
            return name, "unknown key", suggest(name, ROWS)
        if value not in ROWS[name].values:
            return name, f"'{value}' is no choice", suggest(value, ROWS[name].values)
    return None


def resolve(preset: str, choices: Mapping[str, object] | None = None) -> Choices:
    """All choices of a preset, single rows overridden.

    Raises:
        InputError: the preset, a row or a row's value is unknown.
    """
    if preset not in NAMES:
        raise InputError("preset", f"'{preset}' is no preset", suggest(preset, NAMES))
    error = wrong_choice(choices or {})
    if error is not None:
        raise InputError(f"choices.{error[0]}", *error[1:])
    return Choices.model_validate({name: getattr(row, preset) for name, row in ROWS.items()} | dict(choices or {}))
