"""Publishing a run: what is copied, what is recorded, what is refused."""

import json

import pytest
import yaml

from expertaug.errors import InputError
from expertaug.evaluation.publish import publish


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A finished run of one experiment, in name only."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.yaml").write_text(yaml.safe_dump({"results": "out", "run": ["pendulum"]}))
    files = {
        "tables/pendulum.md": "table",
        "figures/pendulum_log_mse.png": "figure",
        "figures/pendulum_log_mse.pdf": "heavy",
        "figures/pendulum_old_log_mse.png": "of an experiment that is no longer run",
        "pendulum/data/train.npz": "data",
        "benchmarks/train/a.tsv": "s\th:m:s\tmax_rss\n12.5\t0:00:12\t300.5\n",
        "benchmarks/train/b.tsv": "s\th:m:s\tmax_rss\n2.5\t0:00:02\tNA\n",
    }
    for name, text in files.items():
        path = tmp_path / "out" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def configs(root):
    from pathlib import Path

    return [Path(__file__).parents[1] / "config/config.yaml", root / "my.yaml"]


def test_tables_figures_and_provenance_are_kept_and_nothing_else(run):
    (run / "kept").mkdir()
    (run / "kept/old").write_text("of an earlier run")
    publish(configs(run), run / "kept", "snakemake --cores 2")
    files = {str(p.relative_to(run / "kept")) for p in (run / "kept").rglob("*") if p.is_file()}
    assert files == {"tables/pendulum.md", "figures/pendulum_log_mse.png"} | {
        "config.yaml",
        "costs.csv",
        "provenance.json",
    }
    record = json.loads((run / "kept/provenance.json").read_text())
    assert record["command"] == "snakemake --cores 2" and record["versions"]["torch"]
    assert record["job_seconds"] == 15 and record["peak_memory_mb"] == 300
    assert yaml.safe_load((run / "kept/config.yaml").read_text())["run"] == ["pendulum"]
    assert list((run / "kept").parent.glob("tmp*")) == []


def test_an_unfinished_run_is_refused_and_the_old_stays(run):
    (run / "out/tables/pendulum.md").unlink()
    (run / "kept").mkdir()
    (run / "kept/old").write_text("of an earlier run")
    with pytest.raises(InputError, match=r"pendulum\.md.*run the workflow"):
        publish(configs(run), run / "kept", "snakemake")
    assert (run / "kept/old").exists()
