"""The configuration of an experiment's data as typed models: simulated sets, chunks of recordings, measurements."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from expertaug.measurements.settings import MeasurementSettings
from expertaug.settings import LEFT_OUT, Name, Noise, Positive, Range, Settings, key
from expertaug.systems.settings import SimulatedSet
from expertaug_recordings.settings import CalibrationKeys, ChunkKeys


class Data(Settings):
    """Where the trajectories come from."""

    source: Literal["simulation", "recordings", "files"] = key(
        ...,
        "simulation = the system's own simulation; recordings = chunks of the recordings; files = your own "
        "measurements",
    )
    t1_s: Positive = key(..., "end of the observed window", "s")
    noise: Noise = key(
        0.0,
        "standard deviation of the noise on every value of the state in simulated sets and augmented samples; a "
        "mapping gives one for each component, but simulated sets take one number only; estimated = from the "
        "roughness of the files' columns",
    )
    seed: Annotated[int, Field(ge=0, lt=2**31)] = key(0, "seed of the simulation")
    step_s: Positive = key(LEFT_OUT, "time between consecutive points of simulated sets", "s")
    t2_s: Positive = key(LEFT_OUT, "end of a simulated trajectory", "s")
    sets: dict[Name, SimulatedSet | None] = key(
        LEFT_OUT,
        "the simulated sets: train, validation, test; iid, with the ranges of validation, is an IID test set; null "
        "removes an inherited set",
    )
    split: ChunkKeys = key(LEFT_OUT, "chunks of the recordings and their division into sets")
    files: MeasurementSettings = key(LEFT_OUT, "your own measurements: tables, the chunks cut from them and their sets")
    start: dict[str, Range] = key(
        dict,
        "for components that are always or sometimes missing from the files: the range, in the component's unit, in "
        "which the first point of a chunk is inferred; left out = a range that goes slightly beyond the measured "
        "values",
    )
    calibrate: bool = key(False, "whether the expert's constants are fitted on the training chunks")
    calibration: CalibrationKeys = key(CalibrationKeys, "how the constants of the compound expert are fitted")
