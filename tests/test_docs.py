"""No example of README or docs that does not pass as written."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from pathlib import Path

import pytest
from running import WINDOW_STUDIES

from docs_pages import PAGES, ROOT, Block, Command, blocks, checkout, commands, every, name_of, run, words
from expertaug import cli
from expertaug import commands as command_line
from expertaug.stages.planned import STUDIES
from nightly import others_slow

LANGUAGES = {"sh", "yaml", "python", "mermaid"}
NOT_RUN: dict[str, int] = {}
# Of the pages with examples in Python, those that take little time.
SHORT = ("docs/diagnostics.md", "docs/measurements.md")
# Subcommands that are run as they are written: they need nothing but what the page shows.
RUN_AS_WRITTEN = ("validate", "check-system", "config", "forecast", "inspect-data")
ALL = list(commands())


@pytest.fixture(scope="session")
def reader(tmp_path_factory):
    """The checkout of a page's reader; pages without files of their own share one."""
    made: dict[str, Path] = {}

    def of(page: str) -> Path:
        key = page if any(block.file for block in blocks(ROOT / page)) else ""
        if key not in made:
            made[key] = checkout(tmp_path_factory.mktemp("reader") / "project", page)
        return made[key]

    return of


@pytest.fixture
def status_of(reader, monkeypatch):
    """The exit status of a command that the reader of a page gives: by a process of its own where the page has modules,
    which nothing else is to import."""

    def of(page: str, *arguments: str) -> int:
        folder = reader(page)
        if any(block.language == "python" and block.file for block in blocks(ROOT / page)):
            done = run(folder, "-m", "expertaug.cli", *arguments)
            sys.stderr.write(done.stderr)
            return done.returncode
        monkeypatch.chdir(folder)
        return cli.main(list(arguments))

    return of


def test_the_first_page_is_short():
    assert words(ROOT / "README.md") <= 500


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    for link in re.findall(r"!?\[[^\]]*\]\(([^)\s]+)\)", text):
        if re.match(r"https?://", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path) if path else page
        assert target.exists(), link
        if anchor:
            titles = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.M)
            assert anchor in {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}, link


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_that_are_named_exist(page):
    folders = "results/published|config|src|benchmarks|docs|tests|workflow|profiles"
    for name in re.findall(rf"`((?:{folders})/[\w./+-]+)`", page.read_text(encoding="utf-8")):
        assert (ROOT / name).exists(), name


def test_every_block_is_of_a_language_that_is_tested():
    assert [str(b) for page in PAGES for b in blocks(page) if b.language not in LANGUAGES] == []


def test_few_blocks_are_not_run():
    skipped = defaultdict(int)
    for block in (b for page in PAGES for b in blocks(page) if b.skipped):
        skipped[block.page] += 1
    assert skipped == NOT_RUN


def test_the_pages_hold_what_is_tested():
    """A change of the marks or of the parser does not leave the tests below without anything to test."""
    assert len(every("python")) >= 8 and len(every("yaml")) >= 5 and len(ALL) >= 60
    assert {"snakemake", "expertaug", "mlflow", "python", "pip"} <= {command.words[0] for command in ALL}


@pytest.mark.parametrize("block", every("yaml"), ids=str)
def test_configurations_are_valid(block: Block, reader, status_of, capsys):
    name = block.file or f"block_{block.line}.yaml"
    (reader(block.page) / name).write_text(block.text, encoding="utf-8")
    status = status_of(block.page, "validate", "config/config.yaml", *block.after, name)
    assert status == 0, capsys.readouterr().err


@pytest.fixture(scope="session")
def executed(reader, tmp_path_factory):
    """What the blocks of a page print: run once, in their order, as one script whose line numbers are the page's."""
    done: dict[str, subprocess.CompletedProcess[str]] = {}

    def of(page: str) -> subprocess.CompletedProcess[str]:
        if page not in done:
            lines: list[str] = []
            for block in blocks(ROOT / page):
                if block.language == "python" and not block.file and not block.skipped:
                    lines += [""] * (block.line - 1 - len(lines)) + block.text.splitlines()
            script = tmp_path_factory.mktemp("script") / Path(page).with_suffix(".py").name
            script.write_text("\n".join(lines) + "\n", encoding="utf-8")
            done[page] = run(reader(page), str(script))
        return done[page]

    return of


# The README's is run by tests/api/test_example.py.
RUN = sorted({block.page for block in every("python")} - {"README.md"}, key=lambda page: (page not in SHORT, page))


@pytest.mark.parametrize("page", others_slow(RUN, len(SHORT)))
def test_python_runs(page, executed):
    done = executed(page)
    assert done.returncode == 0, done.stderr


def test_the_first_example_is_in_the_file_that_is_run():
    (shown,) = (block.text for block in every("python") if block.page == "README.md")
    assert (ROOT / "docs" / "example.py").read_text(encoding="utf-8").endswith(f'"""\n\n{shown}')


def of_program(*names: str) -> list[Command]:
    return [command for command in ALL if command.words[0] in names]


def test_every_program_is_known():
    known = {
        "snakemake",
        "expertaug",
        "mlflow",
        "python",
        "python3",
        "pip",
        "pytest",
        "pre-commit",
        "uv",
        "export",
        "git",
        "cd",
        ".",
    }
    assert {command.words[0] for command in ALL} <= known


@pytest.mark.parametrize("command", of_program("expertaug"), ids=lambda c: c.where)
def test_expertaug_takes_these_arguments(command, capsys):
    arguments = list(command.words[1:])
    if not command.whole and len(arguments) == 1 and not arguments[0].startswith("-"):
        arguments.append("--help")  # named, not called
    try:
        command_line.parse(arguments)
    except SystemExit as stop:
        assert stop.code == 0, capsys.readouterr().err


WRITTEN = [c for c in of_program("expertaug") if c.whole and not c.in_order and c.words[1] in RUN_AS_WRITTEN]
AFTER_LONG = [c for c in WRITTEN if c.page in RUN and c.page not in SHORT]
SOON = [c for c in WRITTEN if c not in AFTER_LONG]


@pytest.mark.parametrize("command", others_slow([*SOON, *AFTER_LONG], len(SOON)), ids=lambda c: c.where)
def test_what_is_written_is_done(command, executed, status_of, capsys):
    if command.page in RUN:
        executed(command.page)  # what it writes may be what the command reads
    assert status_of(command.page, *command.words[1:]) == 0, capsys.readouterr().err


def planned() -> dict[tuple[str, tuple[str, ...]], set[str]]:
    """Targets by page and configuration files; those of pages without files of their own are taken together."""
    from snakemake.cli import get_argument_parser

    found: dict[tuple[str, tuple[str, ...]], set[str]] = defaultdict(set)
    for command in of_program("snakemake"):
        if command.in_order:
            continue  # of files that the commands before it make: tests/test_readme.py
        options = get_argument_parser().parse_args(command.words[1:])
        files = tuple(map(str, options.configfile or ()))
        own = any(block.file in files for block in blocks(ROOT / command.page) if block.file)
        found[command.page if own else "README.md", files] |= set(options.targets)
    return found


PLANNED = planned()


@pytest.mark.parametrize(
    ("page", "files"),
    others_slow(sorted(PLANNED, key=lambda of: len(of[1]))),
    ids=lambda value: value if isinstance(value, str) else "+".join(value) or "default",
)
def test_snakemake_makes_what_is_asked_for(page, files, reader):
    folder, targets = reader(page), sorted(PLANNED[page, files])
    chosen = ["--configfile", *files] if files else []
    if files == ("config/ibm.yaml",):  # the reader is told to say where the recordings are
        (folder / "where.yaml").write_text(
            f"recordings: {{markers: {{path: {folder / 'data/double_pendulum_chaotic'}}}}}"
        )
        files += ("where.yaml",)
    if files == ("config/measurements.yaml",):  # and where the measurements are
        (folder / "measurements").mkdir(exist_ok=True)
        for name, columns in (("real_pend_h_1", 4), ("real_double_pend_h_1", 10)):
            rows = [" ".join(["0", f"{k / 100}", *["1.0"] * (columns - 2)]) for k in range(3)]
            (folder / "measurements" / f"{name}.txt").write_text("\n".join(rows) + "\n")
    targets = sorted(PLANNED[page, files[:1] if files[-1:] == ("where.yaml",) else files])
    chosen = ["--configfile", *files] if files else []
    done = run(folder, "-m", "snakemake", "--quiet", "all", "--dry-run", *targets, *chosen)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("command", of_program("python"), ids=lambda c: c.where)
def test_python_commands_exist(command):
    first, *rest = command.words[1:]
    if first == "-m":
        assert importlib.util.find_spec(rest[0]), rest[0]
        return
    text = (ROOT / first).read_text(encoding="utf-8")
    for option in (word for word in rest if word.startswith("--")):
        assert f'"{option}"' in text, option


@pytest.mark.parametrize("command", of_program("pip", "uv"), ids=lambda c: c.where)
def test_what_is_installed_exists(command):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    given = list(command.words)
    if "-c" in given:
        assert (ROOT / given[given.index("-c") + 1]).is_file()
    if "-e" in given:
        extras = re.fullmatch(r"\.(?:\[(.+)\])?", given[given.index("-e") + 1])
        assert extras and set((extras[1] or "test").split(",")) <= set(project["optional-dependencies"])
    for name, _, version in (word.partition("==") for word in given if "==" in word):
        assert f"{name}=={version}" in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()


@pytest.mark.parametrize("command", of_program("mlflow"), ids=lambda c: c.where)
def test_mlflow_takes_these_options(command):
    from mlflow.cli import cli

    name, *rest = command.words[1:]
    assert cli.commands[name].make_context(name, rest)


@pytest.mark.parametrize("command", of_program("pytest"), ids=lambda c: c.where)
def test_tests_that_are_named_exist(command):
    for word in command.words[1:]:
        assert not word.startswith("tests") or (ROOT / word).exists(), word


@pytest.mark.slow
def test_the_graph_of_the_stages_is_the_workflows(reader):
    """What the page draws is what Snakemake prints, rules of one stage taken together, but for arrows to the target."""
    done = run(reader("docs/workflow.md"), "-m", "snakemake", "--rulegraph", "mermaid-js")
    assert done.returncode == 0, done.stderr
    ending = r"_(of_recording|of_experiment|experiment|seed_group(_with_snapshots)?|set|all)$"
    other_words = {"plot_page": "plot_recording", "study": "studies"}
    other_words |= dict.fromkeys(WINDOW_STUDIES, "study_windows")
    stages = {}
    for number, rule in re.findall(r"(id\d+)\[(\w+)\]", done.stdout):
        study = rule.removesuffix("_of_experiment")
        stage = STUDIES[study].key() if study in STUDIES and study != rule else re.sub(ending, "", rule)
        stages[number] = other_words.get(stage, stage)
    arrows = {(stages[a], stages[b]) for a, b in re.findall(r"(id\d+) --> (id\d+)", done.stdout)}
    drawn = set(re.findall(r"(\w+) --> (\w+)", every("mermaid")[0].text))
    assert drawn <= arrows
    assert {(a, b) for a, b in arrows - drawn if b != "everything"} == set()
