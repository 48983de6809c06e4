"""The stage log-evaluations: the own figures of an experiment's evaluations, and their logs in the tracking store.

One job for all of them: matplotlib and MLflow cost more to import and to start than an evaluation does.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from expertaug import files, plotting
from expertaug.evaluation import traces
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.parameters import parameters
from expertaug.evaluation.products import EVALUATION_LOG, OWN_FIGURES
from expertaug.evaluation.settings import ParameterReading
from expertaug.tracking.log import read_log
from expertaug.tracking.settings import Tracking
from expertaug.tracking.sync import Sync

logger = logging.getLogger(__name__)


def run_stage(forecasts: Sequence[Path], output: Path, tracking: Tracking | None) -> None:
    """Stage: draw forecasts.png and parameters.png beside each forecasts.npz, and store the evaluation's log with them.

    Arguments:
        forecasts: forecasts.npz of all versions and groups of seeds, each with its evaluation.jsonl.
        output: JSON that says of each log whether the store has it, and by ``runs`` (method → seed → run id) which run
            made a method's numbers in the tables.
        tracking: see :class:`expertaug.tracking.run_log.RunLog`; None: figures alone.

    Raises:
        InputError: a file is broken.
    """
    stored: dict[str, bool] = {}
    runs: dict[str, dict[str, str]] = {}
    for path in map(Path, forecasts):
        log = path.with_name(EVALUATION_LOG)
        header = read_log(log).header
        drawn = own_figures(Forecasts.load(path), header.method, header.label)
        plotting.save_all({path.with_name(name): figure for name, figure in drawn.items()})
        logger.info("%s: drawn", path.parent)
        made = None
        if tracking is not None and all(stored.values()):  # a store that fails is not asked again for each log
            made = Sync(log, tracking).finish()
        stored[str(log)] = made is not None
        runs.setdefault(header.label, {}).update(made or {})
    files.write_json(output, {"stored": stored, "runs": runs})


def own_figures(forecasts: Forecasts, method: str, label: str) -> dict[str, Figure]:
    """The figures of one evaluation alone, by the names of their files: forecasts, and estimated parameters.

    Arguments:
        method: whose forecasts they are.
        label: what is printed for it.
    """
    reading, alone = ParameterReading(labels=[(method, label)]), {method: forecasts}
    figures = traces.forecasts(alone, reading), parameters(alone, reading)
    return dict(zip(OWN_FIGURES, figures, strict=True))
