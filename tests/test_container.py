"""The recipe of the container names what is there: no test here can build it."""

import re
import tomllib
from pathlib import Path

from test_wheel import SOURCES

ROOT = Path(__file__).parents[1]
STEPS = [
    line.split(maxsplit=1)
    for line in (ROOT / "Dockerfile").read_text(encoding="utf-8").splitlines()
    if line and not line.startswith("#")
]
CARRIED = [word for step, rest in STEPS if step == "COPY" for word in rest.split()[:-1]]


def test_every_step_is_one_and_what_is_copied_is_there_and_not_ignored():
    assert {step for step, _ in STEPS} <= {"FROM", "WORKDIR", "RUN", "COPY", "ENTRYPOINT"} and STEPS[0][0] == "FROM"
    let_in = [line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!")]
    assert (ROOT / ".dockerignore").read_text().startswith("*\n"), "nothing else goes into the image"
    for name in CARRIED:
        assert (ROOT / name).exists() and any(one == name or one.startswith(f"{name}/") for one in let_in), name


def test_its_torch_is_the_pinned_one_and_its_program_is_installed():
    runs = " ".join(rest for step, rest in STEPS if step == "RUN")
    assert re.findall(r"torch==\S+", runs) == re.findall(r"(?m)^torch==\S+", (ROOT / "constraints.txt").read_text())
    entry = next(rest for step, rest in STEPS if step == "ENTRYPOINT")
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    assert entry == '["expertaug", "run"]' and "expertaug" in scripts


def test_it_copies_what_a_wheel_is_made_of():
    assert set(CARRIED) == {*SOURCES, "constraints.txt", "results/published"}
