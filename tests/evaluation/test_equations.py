"""The table of what an expert lacks, and which methods of an experiment are asked."""

from pathlib import Path

import numpy as np
import pandas as pd

import expertaug as ea
from expertaug.config import jobs, stage_settings
from expertaug.config import load as config
from expertaug.equation.settings import EquationSettings
from expertaug.evaluation.equations import run_stage
from expertaug.evaluation.settings import EquationJob, FittedVersion

ROOT = Path(__file__).parents[2]
T = np.arange(31) * 0.1


def test_the_table_names_the_terms_and_what_they_gain(tmp_path):
    ranges = {"omega0": (2.0, 2.0)}, {"alpha": (0.4, 0.4)}
    sets = {}
    for name in ("train", "validation"):
        sets[name] = ea.simulate(ea.DampedPendulum(), *ranges, n=8, t=T, noise=0.02, name=name)
        sets[name].save(tmp_path / f"{name}.npz")
    how = {"prior": {"omega0": (1.0, 3.0)}, "noise": 0.02, "units": {"omega0": "shared"}}
    ea.least_squares(ea.DampedPendulum(), sets["train"], observed_s=1.5, **how).save(tmp_path / "model.safetensors")
    job = EquationJob(
        experiment="pendulum",
        versions=[FittedVersion("least_squares", "Least squares", None)],
        equation=EquationSettings(most_terms=2, by_hand=["omega: abs(omega)*omega"]),
        device="cpu",
    )
    outputs = [tmp_path / f"equation.{end}" for end in ("csv", "md", "tex")]
    run_stage([tmp_path / "model.safetensors"], tmp_path, outputs, job)
    table = pd.read_csv(outputs[0]).set_index("what")
    found = table.loc["coefficient"]
    assert found["formula"] == "omega: omega" and found["verdict"] == "law"
    assert abs(found["value"] + 0.4) < 4 * found["error"]
    assert table.loc["equation", "log_mse"] < table.loc["by hand", "log_mse"] < table.loc["expert alone", "log_mse"]
    text = outputs[1].read_text()
    assert "what does the expert lack?" in text and "omega: omega" in text and "nan" not in text


def test_which_methods_are_asked():
    asked = {"experiments": {"pendulum": {"equation": {"by_hand": ["omega: omega"]}}}}
    given = config.load([ROOT / "config" / "config.yaml"])
    assert jobs.list_explained(config.validate(given), "pendulum") == []  # nobody asked
    given["experiments"]["pendulum"] |= asked["experiments"]["pendulum"]
    found = config.validate(given)
    methods = jobs.list_explained(found, "pendulum")
    assert methods[0] == "least_squares" and "aphynity" in methods and "ml_only" not in methods
    job = EquationJob.from_mapping(stage_settings.equation(found, "pendulum"))
    assert [one.version for one in job.versions] == methods
    assert job.equation.by_hand == ["omega: omega"]
