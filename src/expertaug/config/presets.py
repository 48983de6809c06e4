"""Where the paper and the authors' code disagree, and what each preset does.

One row of :data:`ROWS` is one choice: its meaning and the value under each preset.  ``paper`` follows the text,
``code`` the authors' release as it behaves, ``corrected`` (the default) what this project takes for right.  A An
experiment's ``choices`` override single rows; whatever is listed here is what the stages obey.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from expertaug.errors import InputError
from expertaug.wording import suggest

NAMES = ("paper", "code", "corrected")


@dataclass(frozen=True)
class Row:
    """One choice: what it decides, what it may be, and its value under each preset."""

    meaning: str
    values: tuple
    paper: object
    code: object
    corrected: object


ROWS: dict[str, Row] = {
    "loss_window": Row(
        "points of a trajectory that the loss sees where data.t1_s limits it: observed = [t0, t1] only; "
        "half_batch = all of [t0, t2] for half of each batch (the authors' slip: the forecast leaks)",
        ("observed", "half_batch"),
        paper="observed",
        code="half_batch",
        corrected="observed",
    ),
    "observed_points": Row(
        "whether the observed window includes the point at t1 (51 points at 0.1 s and 5 s) or stops before it (50)",
        ("inclusive", "exclusive"),
        paper="inclusive",
        code="exclusive",
        corrected="inclusive",
    ),
    "multiplier": Row(
        "the multiplier of the Lagrangian: lagrangian = raised by tau2 times the data term every so many passes; "
        "fixed = stays at its first value",
        ("lagrangian", "fixed"),
        paper="lagrangian",
        code="fixed",
        corrected="lagrangian",
    ),
    "penalty": Row(
        "size of F_a in the loss: rms = root mean square along the predicted trajectory; "
        "norm_data = mean Euclidean norm on the data's states",
        ("rms", "norm_data"),
        paper="rms",
        code="norm_data",
        corrected="rms",
    ),
    "loss_normalisation": Row(
        "whether the data term is divided by its first value, over the full loss window",
        ("none", "first"),
        paper="none",
        code="first",
        corrected="none",
    ),
    "noise": Row(
        "standard deviation of the observation noise of simulated sets: config = data.noise, none = 0",
        ("config", "none"),
        paper="none",
        code="config",
        corrected="config",
    ),
    "frozen": Row(
        "what fine-tuning leaves alone: interaction = F_a only; interaction_and_z_e_head = also the encoder's z_e head",
        ("interaction", "interaction_and_z_e_head"),
        paper="interaction",
        code="interaction_and_z_e_head",
        corrected="interaction",
    ),
    "resample": Row(
        "augmented samples are drawn once, or anew for every pass",
        ("once", "epoch"),
        paper="once",
        code="once",
        corrected="once",
    ),
    "augmentation_noise": Row(
        "whether augmented samples get the noise of the data",
        ("as_data", "none"),
        paper="none",
        code="none",
        corrected="as_data",
    ),
    "augmented_x": Row(
        "x of augmented samples: data = the sample's own; resampled = drawn anew where the system can "
        "(the double pendulum's two angles), which the authors' code does",
        ("data", "resampled"),
        paper="data",
        code="resampled",
        corrected="data",
    ),
    "augmented_z_a": Row(
        "z_a of augmented samples: posterior = drawn from q(z_a | x, y); prior = from N(0, I) where the posterior is "
        "no point estimate, which the authors' hybrid-VAE does",
        ("posterior", "prior"),
        paper="posterior",
        code="prior",
        corrected="posterior",
    ),
    "hvae_z_e": Row(
        "the hybrid-VAE's z_e in training: sampled = a sample of q(z_e | x, y); mean = its mean, without a divergence "
        "(the authors' pendulum)",
        ("sampled", "mean"),
        paper="sampled",
        code="mean",
        corrected="sampled",
    ),
    "supervision": Row(
        "the z_e term of augmented samples: standardised = Gaussian log-density with z_e in units of p+'s standard "
        "deviation; raw = squared error in the parameter's own unit; off = none",
        ("standardised", "raw", "off"),
        paper="standardised",
        code="raw",
        corrected="standardised",
    ),
    "forecast_start": Row(
        "the state from which the forecast is integrated: y0, or y_t1 (the last observed point)",
        ("y0", "y_t1"),
        paper="y0",
        code="y0",
        corrected="y0",
    ),
    "selection": Row(
        "points of the validation set that choose the best model: observed = [t0, t1], forecast = (t1, t2]",
        ("observed", "forecast"),
        paper="observed",
        code="forecast",
        corrected="observed",
    ),
}


def wrong_choice(choices: Mapping[str, object]) -> tuple[str, str, str] | None:
    """The first row that does not exist, or not with its value: the row, what was found, what would be right."""
    for name, value in choices.items():
        if name not in ROWS:
            return name, "unknown key", suggest(name, ROWS)
        if value not in ROWS[name].values:
            return name, f"'{value}' is no choice", suggest(value, ROWS[name].values)
    return None


def resolve(preset: str, choices: Mapping[str, object] | None = None) -> dict[str, object]:
    """All choices of a preset, single rows overridden.

    Raises:
        InputError: the preset, a row or a row's value is unknown.
    """
    if preset not in NAMES:
        raise InputError("preset", repr(preset), f"one of {', '.join(NAMES)}")
    found = wrong_choice(choices or {})
    if found is not None:
        raise InputError(f"choices.{found[0]}", *found[1:])
    return {name: getattr(row, preset) for name, row in ROWS.items()} | dict(choices or {})
