"""The stage dissipation: the power that models of a pendulum dissipate, beside the measured loss of energy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from expertaug.errors import InputError
from expertaug.evaluation.dissipation_report import draw, latex, markdown
from expertaug.evaluation.energy_balance import dissipated_power, measured_loss
from expertaug.evaluation.evaluate import spread
from expertaug.evaluation.formats import DRAWN, write_tables
from expertaug.inference.least_squares import estimator_of
from expertaug.labels import MAIN_SETS, trained
from expertaug.learning.sets import StackedSet
from expertaug.models import store
from expertaug.models.device import device_of
from expertaug.systems.settings import CONSERVING
from expertaug.trajectories import Trajectories

CHUNKS = 1000  # of each set, evenly spread


def dissipation(models: Sequence[Path], data: Path, outputs: Sequence[Path], settings: Mapping) -> None:
    """Write the tables and draw the figure.

    Arguments:
        models: model files of every version that is trained, and of all groups of seeds.
        data: folder of train.npz, validation.npz and test.npz.
        outputs: any of .csv (a row for each version, seed, set and recording), .md, .tex, .png and .pdf.
        settings: {experiment, versions, all_methods, set_titles, title, device}; ``versions`` has [version, label,
            refinement] in the order of the tables, the last as in :func:`expertaug.evaluation.evaluate.evaluate`, null
            where estimates are not refined; ``classes`` as there.

    Raises:
        InputError: a model is of another system or of no version, a version has no model, or an output's suffix is
            unknown.
    """
    device = device_of(settings["device"])
    chunks = {name: spread(Trajectories.load(Path(data) / f"{name}.npz"), CHUNKS) for name in MAIN_SETS}
    files = _by_method(models, settings)
    parts = []
    for version, label, refinement in settings["versions"]:
        for path in files[trained(version)]:
            stored = store.load(path, device, settings.get("classes", ()))
            rows = _losses(stored, refinement, chunks, device)
            parts.append(rows.assign(experiment=settings["experiment"], method=version, label=label))
    columns = ["experiment", "method", "label", "seed", "expert", "set", "recording", "chunks"]
    table = pd.concat(parts, ignore_index=True)[[*columns, "measured", "measured_se", "dissipated"]]
    drawn = [path for path in map(Path, outputs) if path.suffix in DRAWN]
    texts = {
        ".csv": lambda _: table.to_csv(index=False, float_format="%.7g"),
        ".md": lambda _: markdown(table, settings),
        ".tex": lambda _: latex(table, settings),
    }
    write_tables([path for path in map(Path, outputs) if path not in drawn], texts)
    if drawn:
        draw(table, drawn, settings)


def _by_method(models: Sequence[Path], settings: Mapping) -> dict[str, list[Path]]:
    """Model files by the version that they were trained as."""
    wanted = list(dict.fromkeys(trained(version) for version, *_ in settings["versions"]))
    files: dict[str, list[Path]] = {name: [] for name in wanted}
    for path in map(Path, models):
        description = store.read_tensors(path)[0]
        if description["system"]["name"] not in CONSERVING:
            raise InputError(
                path, f"a model of {description['system']['name']}", f"give one of {', '.join(CONSERVING)}"
            )
        if description["method"] not in files:
            raise InputError(path, f"a model of '{description['method']}'", f"give those of {', '.join(wanted)}")
        files[description["method"]].append(path)
    if missing := [name for name in wanted if not files[name]]:
        raise InputError(missing[0], "no model of this version", "give a model of every version")
    return files


def _losses(
    stored: store.StoredModel, refinement: Mapping | None, sets: Mapping[str, Trajectories], device: torch.device
) -> pd.DataFrame:
    """Mean loss of energy, as a model's expert has it, of every seed on every set and recording: measured, its standard
    error over chunks, and dissipated by the model, which is NaN of seeds that could not be trained."""
    refinement = refinement or stored.description.get("refinement")
    decoder = getattr(stored.model, "decoder", stored.model)
    estimator = stored.model
    if refinement is not None:
        estimator = estimator_of(stored, **refinement)
    observed, rows = stored.description["observed"], []
    for name, chunks in sets.items():
        windows = StackedSet.of(chunks, device).windows(len(chunks.t))
        windows = windows.expand(-1, len(stored.seeds), *windows.shape[2:])
        with torch.no_grad():
            found = None if decoder.interaction is None else estimator.estimate(windows[:observed])
        power = dissipated_power(decoder, windows, found).cpu().numpy()
        z_e = windows.new_zeros(len(stored.seeds), len(chunks), 1) if found is None else found.z_e
        assert z_e is not None
        measured = measured_loss(decoder.system, torch.from_numpy(chunks.t).to(device), windows, z_e).cpu().numpy()
        own = recordings_of(chunks)
        for recording in dict.fromkeys(own):
            inside = own == recording
            for seed, of_seed, lost in zip(stored.seeds, power[:, inside], measured[:, inside], strict=True):
                known = np.isfinite(lost)
                rows.append(
                    {
                        "seed": seed,
                        "expert": stored.description["system"].get("expert", ""),
                        "set": name,
                        "recording": recording,
                        "chunks": int(known.sum()),
                        "measured": lost[known].mean(),
                        "measured_se": lost[known].std() / np.sqrt(known.sum()),
                        "dissipated": np.nan if seed in stored.failed else of_seed[known].mean(),
                    }
                )
    return pd.DataFrame(rows)


def recordings_of(chunks: Trajectories) -> np.ndarray:
    """The recording of each chunk, (N,): ids are recording/first frame; one for all where there are none."""
    if chunks.id is None:
        return np.full(len(chunks), "all")
    return np.array([identity.rpartition("/")[0] for identity in chunks.id])
