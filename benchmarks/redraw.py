"""Draw figures of scores, of estimates and of lost energy of published runs anew from their tables, by today's code.

    python benchmarks/redraw.py results/published/default results/published/ten_seeds_rlc

Figures whose samples are not published (forecasts, coverage, alarms …) stay as they are; so do those that the run has
not.  Where its configuration names measurements or recordings, start it where they lie.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from expertaug import plotting
from expertaug.config import load as config
from expertaug.config import report_parameters, stage_settings
from expertaug.evaluation import dissipation, dots, estimates
from expertaug.evaluation.settings import DissipationJob, EstimatesJob, OverviewJob, PlotJob
from expertaug.evaluation.summary import read_long
from expertaug.rows import read_csv
from expertaug.runs.publish import copy
from expertaug.stages import STAGES

DEFAULTS = Path(__file__).parents[1] / "config" / "config.yaml"


def redraw(folder: Path) -> list[str]:
    """Names of the figures that were drawn."""
    whole = config.complete_configuration(config.load([DEFAULTS, folder / "config.yaml"]), STAGES)
    tables = {name: folder / "tables" / f"{name}_long.csv" for name in whole.run}
    with tempfile.TemporaryDirectory() as made:
        new = Path(made)
        for name, table in tables.items():
            job = PlotJob.from_mapping(report_parameters.plot(whole, name))
            rows = read_long(table)
            plotting.save_all({new / f"{name}_log_mse": dots.log_mse(rows, job)})
            plotting.save_all({new / f"{name}_parameter_errors": dots.parameter_errors(rows, job)})
            stated = folder / "tables" / f"{name}_estimates.csv"
            if stated.is_file():
                job = EstimatesJob.from_mapping(report_parameters.estimates(whole, name))
                title = f"{job.of_experiment(name)}: estimates"
                with plotting.use_style():
                    figure = estimates.draw(read_csv(stated, estimates.TabledEstimate, "publish it again"), job, title)
                plotting.save_all({new / f"{name}_estimates": figure})
            losses = folder / "tables" / f"{name}_dissipation.csv"
            if losses.is_file():
                job = DissipationJob.from_mapping(stage_settings.dissipation(whole, name))
                figure = dissipation.draw(read_csv(losses, dissipation.Loss, "publish it again"), job)
                plotting.save_all({new / f"{name}_dissipation": figure})
        of_all = OverviewJob.from_mapping(report_parameters.overview(whole, whole.run))
        dots.run_stage(list(tables.values()), new, of_all)
        drawn = [path for path in sorted(new.glob("*.png")) if (folder / "figures" / path.name).exists()]
        for path in drawn:
            copy(path, folder / "figures" / path.name)
    return [path.name for path in drawn]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", help="published runs")
    for one in parser.parse_args().folders:
        print(f"{one}: {', '.join(redraw(one))}")
