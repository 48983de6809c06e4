"""Publishing a run: what is copied, what is recorded, what is refused."""

import functools
import json
import re
import tempfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from expertaug import plotting
from expertaug.cli import main
from expertaug.config import load as config
from expertaug.errors import InputError
from expertaug.runs import publish as publishing
from expertaug.stages.files import Files
from expertaug.stages.planned import list_kept as kept_files
from expertaug.stages.planned import products_of, products_of_all

ROOT = Path(__file__).parents[2]


def publish(config, folder, command):
    publishing.publish(config, folder, command, kept_files)


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A finished run of one experiment, in name only."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my.yaml").write_text(yaml.safe_dump({"results": "out", "run": ["pendulum"]}))
    files = {
        "tables/pendulum.md": "table",
        "tables/pendulum_dissipation.md": "a study",
        "tables/pendulum_own_priors.md": "what p⁺ found",
        "figures/pendulum_log_mse.png": "figure",
        "figures/pendulum_log_mse.pdf": "heavy",
        "figures/pendulum_old_log_mse.png": "of an experiment that is no longer run",
        "pendulum/data/train.npz": "data",
        "logs/train/pendulum_aphynity_seeds_0.cost.json": '{"seconds": 12.5, "peak_memory_mb": 300.5}',
        "logs/validity/pendulum.cost.json": '{"seconds": 2.5, "peak_memory_mb": 0}',
        # Of a larger run in the same folder.
        "logs/train/pendulum_shift_aphynity_seeds_0.cost.json": '{"seconds": 7, "peak_memory_mb": 900}',
        "logs/track_markers/rendered_00.cost.json": '{"seconds": 7, "peak_memory_mb": 900}',
        "recordings/summary.md": "of recordings",
    }
    for name, text in files.items():
        path = tmp_path / "out" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path


def settings(root):
    return validated((root / "my.yaml").read_text())


@functools.cache
def validated(text):
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "my.yaml").write_text(text)
        return config.validate(config.load([ROOT / "config/config.yaml", Path(folder) / "my.yaml"]))


def test_a_table_that_a_link_brings_from_elsewhere_is_refused(run):
    (run / "secret").write_text("secret")
    (run / "out/tables/pendulum_dissipation.md").unlink()
    (run / "out/tables/pendulum_dissipation.md").symlink_to(run / "secret")
    with pytest.raises(InputError, match=r"pendulum_dissipation\.md: leads out of out; put the file itself there"):
        publish(settings(run), Path("kept"), "snakemake")
    assert not (run / "kept").exists()


def test_tables_figures_and_provenance_are_kept_and_nothing_else(run):
    (run / "out/tables/published.md").write_text("of an earlier run")
    publish(settings(run), run / "kept", "snakemake")
    (run / "out/tables/published.md").unlink()
    publish(settings(run), run / "kept", "snakemake --cores 2")
    files = {str(p.relative_to(run / "kept")) for p in (run / "kept").rglob("*") if p.is_file()}
    assert files == {"tables/pendulum.md", "tables/pendulum_dissipation.md", "figures/pendulum_log_mse.png"} | {
        "tables/pendulum_own_priors.md",
        "config.yaml",
        "costs.csv",
        "provenance.json",
    }
    record = json.loads((run / "kept/provenance.json").read_text())
    assert record["command"] == "snakemake --cores 2" and record["versions"]["torch"]
    assert record["job_seconds"] == 15 and record["peak_memory_mb"] == 300
    assert set(record["files"]) == files
    jobs = [line.split(",")[0] for line in (run / "kept/costs.csv").read_text().splitlines()[1:]]
    assert jobs == ["train/pendulum_aphynity_seeds_0", "validity/pendulum"]
    assert yaml.safe_load((run / "kept/config.yaml").read_text())["run"] == ["pendulum"]
    assert {path.name for path in run.iterdir()} == {"kept", "my.yaml", "out"}


def test_an_unfinished_run_is_refused_and_the_old_stays(run):
    (run / "out/tables/pendulum.md").unlink()
    (run / "kept").mkdir()
    (run / "kept/old").write_text("of an earlier run")
    with pytest.raises(InputError, match=r"pendulum\.md.*run the workflow"):
        publish(settings(run), run / "kept", "snakemake")
    assert (run / "kept/old").exists()


def test_a_run_that_has_not_ended_is_refused_by_the_command(run, capsys):
    """Whatever of its tables and figures is missing, studies too; what is published is what the workflow makes."""
    arguments = ["publish", "my.yaml", "--to", "kept", "--command", "snakemake"]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert re.search(r"no such file \(and \d+ others\); run the workflow to its end first", said)
    assert not (run / "kept").exists()
    files = Files(settings(run))
    for path in [*products_of_all(files), *products_of(files, "pendulum")]:
        if not Path(path).exists():
            Path(path).parent.mkdir(parents=True, exist_ok=True)
            Path(path).write_text("made")
    assert main(arguments) == 0
    Path("out/tables/pendulum_distance.md").unlink()
    assert main(arguments) == 2
    assert "pendulum_distance.md: no such file; run the workflow" in capsys.readouterr().err


def everything(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    "target", [".", "..", "out", "out/pendulum", "theses", "a_file", "clone", "linked", "clone/.git/x"]
)
def test_what_publishing_did_not_make_is_refused_and_stays(run, target):
    (run / "theses").mkdir()
    (run / "theses/mine.tex").write_text("years of work")
    (run / "theses/provenance.json").write_text('{"by": "somebody else"}')
    (run / "linked").symlink_to("theses")
    (run / "a_file").write_text("text")
    (run / "clone/.git").mkdir(parents=True)
    (run / "clone/.git/HEAD").write_text("ref")
    (run / "clone/provenance.json").write_text('{"command": "snakemake", "git_revisions": []}')
    before = everything(run)
    with pytest.raises(InputError, match="choose a folder that does not exist yet"):
        publish(settings(run), run / target, "snakemake")
    assert everything(run) == before


@pytest.mark.parametrize("kept", ["", "out"], ids=["working directory", "results"])
def test_a_published_folder_is_refused_once_it_holds_something_else(run, kept, monkeypatch):
    publish(settings(run), run / "kept", "snakemake")
    if kept:
        (run / "out").rename(run / "kept/out")
        (run / "my.yaml").write_text(yaml.safe_dump({"results": "kept/out", "run": ["pendulum"]}))
    else:
        (run / "my.yaml").write_text(yaml.safe_dump({"results": str(run / "out"), "run": ["pendulum"]}))
        monkeypatch.chdir(run / "kept")
    with pytest.raises(InputError, match=r"is or contains the (working directory|results folder)"):
        publish(settings(run), run / "kept", "snakemake")


def test_a_file_that_somebody_put_into_a_published_folder_is_named_and_stays(run):
    publish(settings(run), run / "kept", "snakemake")
    (run / "kept/tables/notes.md").write_text("mine")
    with pytest.raises(InputError, match=r"kept/tables/notes\.md: publish did not write this file"):
        publish(settings(run), run / "kept", "snakemake")
    assert (run / "kept/tables/notes.md").read_text() == "mine"


def test_what_somebody_put_beside_what_an_old_record_does_not_list_is_named_and_stays(run):
    """Records of before had no list of files; what publishing made is known by its name all the same."""
    publish(settings(run), run / "kept", "snakemake")
    record = json.loads((run / "kept/provenance.json").read_text())
    del record["files"]
    (run / "kept/provenance.json").write_text(json.dumps(record))
    (run / "kept/thesis.md").write_text("years of work")
    with pytest.raises(InputError, match=r"kept/thesis\.md: publish did not write this file"):
        publish(settings(run), run / "kept", "snakemake")
    assert (run / "kept/thesis.md").read_text() == "years of work"
    (run / "kept/thesis.md").unlink()
    publish(settings(run), run / "kept", "snakemake")
    assert "files" in json.loads((run / "kept/provenance.json").read_text())


def test_every_table_and_figure_that_the_workflow_makes_is_kept():
    """Outputs of rules under tables/ or figures/ are files of the declared products, and each is kept."""
    rules = "".join(path.read_text() for path in (ROOT / "workflow/rules").glob("*.smk"))
    stems = set(re.findall(r'(?:table|figure|results)\(f?"(?:(?:tables|figures)/)?\{+experiment\}+(\w*)', rules))
    assert {"_splits", "_published", "_long"} <= stems
    declared = kept_files(["EXPERIMENT"])
    for stem in stems - {"_"}:  # named by the products themselves
        assert any(file.partition("/")[2].startswith(f"EXPERIMENT{stem}.") for file in declared), f"{stem} is not kept"


def test_a_link_to_a_published_folder_stays_a_link(run):
    publish(settings(run), run / "first", "snakemake")
    (run / "latest").symlink_to("first")
    publish(settings(run), run / "latest", "snakemake again")
    assert (run / "latest").is_symlink()
    assert json.loads((run / "first/provenance.json").read_text())["command"] == "snakemake again"


def test_a_failure_while_replacing_brings_the_old_back(run, monkeypatch):
    publish(settings(run), run / "kept", "snakemake")
    before = everything(run / "kept")
    rename = Path.rename

    def fail(path, target):
        if path.name == "new":
            raise OSError("no")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(OSError, match="no"):
        publish(settings(run), run / "kept", "snakemake again")
    assert everything(run / "kept") == before
    assert {path.name for path in run.iterdir()} == {"kept", "my.yaml", "out"}


def test_pictures_are_kept_small_and_look_the_same(run):
    figure = run / "out" / "figures" / "pendulum_log_mse.png"
    with plotting.use_style():
        drawn = plotting.new_figure(3)
        axes = drawn.subplots()
        for k in range(12):
            axes.plot(np.sin(np.arange(200) / (k + 3)))
        plotting.save(drawn, figure)
    publish(settings(run), run / "kept", "snakemake")
    kept = run / "kept" / "figures" / "pendulum_log_mse.png"
    assert kept.stat().st_size < 0.5 * figure.stat().st_size
    with Image.open(figure) as before, Image.open(kept) as after:
        off = np.abs(np.asarray(before.convert("RGB"), float) - np.asarray(after.convert("RGB"), float))
    assert off.max() < 64 and off.mean() < 0.5
