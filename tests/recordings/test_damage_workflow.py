"""on_bad_recording in the workflow: one of three recordings is bad, and what is redone when that changes."""

import os
import re
import subprocess
from pathlib import Path

import pandas as pd
import pytest
import yaml
from pendulum_motion import markers, truth

import warm_python
from expertaug.files import sha256

ROOT = Path(__file__).parents[2]
COLUMNS = ["pivot_y", "pivot_x", "joint_y", "joint_x", "tip_y", "tip_x"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Marker CSVs of three recordings; the second has text in it."""
    folder = tmp_path_factory.mktemp("bad")
    (folder / "csv").mkdir()
    for k in range(3):
        table = markers(truth()[k, :1200])[COLUMNS] * 5 + 2
        table.round().astype(int).to_csv(folder / "csv" / f"{k}.csv", header=False, index=False)
    text = (folder / "csv" / "1.csv").read_text()
    (folder / "sound.csv").write_text(text)
    (folder / "csv" / "1.csv").write_text(text.replace("\n", "\nlost,", 1))
    return folder


def snakemake(folder, *arguments, **recordings):
    change = {
        "results": "results",
        "run": ["double_pendulum"],
        "recordings": {"source": "markers", "markers": {"path": "csv"}, **recordings},
    }
    (folder / "change.yaml").write_text(yaml.safe_dump(change))
    files = [ROOT / "config" / "smoke.yaml", folder / "change.yaml"]
    command = [warm_python.interpreter(), "-m", "snakemake", "-s", ROOT / "Snakefile", "--cores", "2", "recordings"]
    return subprocess.run(
        [*map(str, [*command, *arguments]), "--configfile", *map(str, files)],
        cwd=folder,
        env=os.environ | {"PATH": warm_python.path(), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )


def planned(folder, **recordings):
    done = snakemake(folder, "-n", "--quiet", "host", **recordings)
    assert done.returncode == 0, done.stdout + done.stderr
    table = (done.stdout + done.stderr).rpartition("Job stats:")[2].partition("total")[0]
    return {rule: int(n) for rule, n in re.findall(r"^(\w+) +(\d+)$", table, re.MULTILINE) if rule != "recordings"}


@pytest.mark.slow
def test_a_bad_recording_stops_or_is_left_out_and_tried_again(folder):
    again = {"import_markers_of_recording": 1, "measure_angles_of_recording": 1}
    again |= {"plot_page_of_recording": 1, "summarise_recordings": 1}
    stopped = snakemake(folder)
    assert stopped.returncode == 1
    told = [line for line in stopped.stderr.splitlines()[-5:] if "csv/1.csv: row 2: too many columns" in line]
    assert len(told) == 1 and told[0].endswith("(log: results/logs/import_markers/1.log)"), "told again at the end"

    skipped = snakemake(folder, on_bad_recording="skip")
    assert skipped.returncode == 0, skipped.stderr
    table = pd.read_csv(folder / "results" / "recordings" / "summary.csv", dtype={"recording": str}).set_index(
        "recording"
    )
    assert list(table.index) == ["0", "1", "2"]
    assert "row 2: too many columns" in table.loc["1", "refused"]
    assert table["refused"].isna().tolist() == [True, False, True]
    assert "- 1: csv/1.csv: row 2: too many" in (folder / "results" / "recordings" / "summary.md").read_text()

    assert planned(folder, on_bad_recording="skip") == {}
    assert planned(folder) == again
    (folder / "csv" / "1.csv").write_text((folder / "sound.csv").read_text())
    assert planned(folder, on_bad_recording="skip") == again


@pytest.mark.slow
def test_checksums_are_checked_before_any_job(folder):
    lines = [f"{sha256(folder / 'csv' / f'{k}.csv')}  {k}.csv\n" for k in range(3)]
    (folder / "SHA256SUMS").write_text("".join(lines[:2]))
    done = snakemake(folder, checksums="SHA256SUMS")
    assert done.returncode == 2
    assert "configuration: recordings.checksums: 'SHA256SUMS' has no line for 2.csv" in done.stderr
    (folder / "SHA256SUMS").write_text("".join(lines))
    assert planned(folder, checksums="SHA256SUMS")["import_markers_of_recording"] == 3
