"""Settings of inference; torch is not loaded here."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from expertaug.settings import LEFT_OUT, Count, Positive, Range, Settings, key
from expertaug.systems.settings import SolverSettings


class RefinementSettings(Settings):
    """Least squares on each observed window: of the expert alone, or from a trained model's estimates."""

    WHERE: ClassVar[str] = "refinement"

    starts: Annotated[int, Field(ge=0, le=100_000)] = key(
        32, "points of p⁺ at which a window is compared with the model; 0 = only from the trained model's estimate"
    )
    tries: Count = key(3, "the best of them from which the fit starts, beside the trained model's own estimate")
    steps: Count = key(30, "Levenberg–Marquardt steps, at most")
    noise: Positive = key(
        LEFT_OUT,
        "standard deviation of the observation; left out = the data's, and where they have none a thousandth of the "
        "training set's largest value",
    )
    free_start: bool = key(LEFT_OUT, "whether the first point is estimated too; left out = where the data have noise")
    latent_width: Positive = key(
        3.0, "how far z_a may go from the training windows' mean, in their standard deviations: a weak Gaussian prior"
    )
    windows: dict[str, Range] = key(
        LEFT_OUT, "from when to when each component counts, in s; left out = all of the observed window"
    )
    solver: SolverSettings = key(LEFT_OUT, "of the fit; left out = the training's")
