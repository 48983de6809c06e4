"""The configuration of an experiment's data as typed models: simulated sets, chunks of recordings, measurements."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from expertaug.measurements.settings import MeasurementSettings
from expertaug.recordings.angles.settings import CalibrationKeys
from expertaug.recordings.chunks.settings import ChunkKeys
from expertaug.settings import KEYS, LEFT_OUT, ONE, Name, NotNegative, Positive, Range, Settings, by_shape, key

Noise = Annotated[
    Annotated[NotNegative | Literal["estimated"], ONE] | Annotated[dict[str, NotNegative], KEYS], by_shape
]


class SimulatedSet(Settings):
    """One simulated set."""

    size: int = key(..., "trajectories", ge=1, le=10**8)
    z_e: dict[str, Range] = key(..., "range of each expert parameter, in its unit")
    z_a: dict[str, Range] = key(dict, "range of each parameter of the true interaction, in its unit")
    inputs: dict[str, Range] = key(
        LEFT_OUT, "of a driven system, range of each number that known inputs are drawn from, and of each covariate"
    )


class Data(Settings):
    """Where the trajectories come from."""

    source: Literal["simulation", "recordings", "files"] = key(
        ..., "simulation = the system's own; recordings = chunks of the recordings; files = measurements of your own"
    )
    t1_s: Positive = key(..., "end of the observed window", "s")
    noise: Noise = key(
        0.0,
        "standard deviation of the noise on every value of the state, or a mapping with one for each component, which "
        "simulated sets (of the first kind) and augmented samples get; estimated = from how rough the columns of files "
        "are",
    )
    seed: Annotated[int, Field(ge=0, lt=2**31)] = key(0, "of the simulation")
    step_s: Positive = key(LEFT_OUT, "time from point to point of simulated sets", "s")
    t2_s: Positive = key(LEFT_OUT, "end of a simulated trajectory", "s")
    sets: dict[Name, SimulatedSet | None] = key(
        LEFT_OUT,
        "the simulated sets: train, validation, test; iid, with validation's ranges, is an IID test set; null takes an "
        "inherited one away",
    )
    split: ChunkKeys = key(LEFT_OUT, "chunks of the recordings and their division into sets")
    files: MeasurementSettings = key(LEFT_OUT, "measurements of your own: tables, chunks of them and their sets")
    start: dict[str, Range] = key(
        dict,
        "of components that files do not have, or not always: range, in its unit, in which the first point of a chunk "
        "is inferred; left out = a little beyond the measured values",
    )
    calibrate: bool = key(False, "whether the expert's constants are fitted on the training chunks")
    calibration: CalibrationKeys = key(CalibrationKeys, "how the constants of the compound expert are fitted")
