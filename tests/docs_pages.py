"""What the documentation's pages hold: their blocks of code, the commands in them, and a checkout to run them in."""

from __future__ import annotations

import math
import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import warm_python

ROOT = Path(__file__).parents[1]
SITE = ("index.md", "api.md")  # Sphinx directives alone: building the site tests them
OWN = sorted(page for page in ROOT.glob("docs/*.md") if page.name not in SITE)
RECORDS = [ROOT / "benchmarks" / "README.md", ROOT / "results" / "published" / "search" / "README.md"]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "config" / "README.md", *OWN, *RECORDS]
FENCE = re.compile(r"^(?:<!-- (?P<mark>[^\n]+) -->\n)?```(?P<language>\w*)\n(?P<text>.*?)^```$", re.M | re.S)
INDENTED = re.compile(r"(?:^    [^\n]*\n(?:[ ]*\n(?=    ))*)+", re.M)
SPAN = re.compile(r"`((?:snakemake|expertaug|mlflow|python|pip|pytest)\s[^`]+)`")
PROGRAMS = ("snakemake", "expertaug", "mlflow", "python", "python3", "pip", "pytest", "pre-commit", "uv", "export")
# What a reader of a page has, beside the files that the page shows.
BROUGHT = {"my/clip.mp4": "", "board.png": "", "data/double_pendulum_chaotic/0.csv": "", "my.yaml": "run: [pendulum]\n"}


@dataclass(frozen=True)
class Block:
    """A block of code: ``file`` where the reader is to keep it, ``after`` which others it overrides, ``skipped`` why
    the test is not to run it, ``in_order`` whether each command needs what those before it have made."""

    page: str
    line: int
    language: str
    text: str
    file: str | None = None
    after: tuple[str, ...] = ()
    skipped: str | None = None
    in_order: bool = False

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


@dataclass(frozen=True)
class Command:
    """A command as the page has it; ``whole`` is false in running text, which may leave arguments out."""

    where: str
    page: str
    words: tuple[str, ...]
    whole: bool
    in_order: bool = False


def swings() -> str:
    """A table of six swings of a pendulum, as a lab writes it: ms and degrees, now and then without a row."""
    lines = ["trial,time,angle"]
    for trial in range(6):
        angle, speed = 0.2 + 0.2 * trial, 0.0
        for k in range(3000):
            if k % 25 == 0 and k % 1075:
                lines.append(f"{trial},{2 * k},{math.degrees(angle) + 0.2 * math.sin(12.9898 * k):.3f}")
            speed += 0.002 * (-4.0 * math.sin(angle) - 0.1 * speed)
            angle += 0.002 * speed
    return "\n".join(lines) + "\n"


BROUGHT["lab/swings.csv"] = swings()


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path) -> list[Block]:
    """Fenced and indented blocks; ``<!-- file: NAME -->``, ``<!-- file: NAME, after OTHER -->``,
    ``<!-- in order -->`` and ``<!-- not run: WHY -->`` on the line before a fence say more."""
    text = page.read_text(encoding="utf-8")
    found = []
    for match in FENCE.finditer(text):
        mark = match["mark"] or ""
        kept = re.fullmatch(r"file: ([^,]+)(?:, after (.+))?", mark)
        skipped = re.fullmatch(r"not run: (.+)", mark)
        found.append(
            Block(
                page=name_of(page),
                line=text.count("\n", 0, match.start("text")) + 1,
                language=match["language"],
                text=match["text"],
                file=kept[1] if kept else None,
                after=tuple(kept[2].split(", ")) if kept and kept[2] else (),
                skipped=skipped[1] if skipped else None,
                in_order=mark == "in order",
            )
        )
    rest = FENCE.sub(lambda match: "\n" * match[0].count("\n"), text)
    for match in INDENTED.finditer(rest):
        code = "".join(line[4:] or "\n" for line in match[0].splitlines(keepends=True))
        language = "sh" if code.split()[0] in PROGRAMS else "yaml"
        found.append(Block(name_of(page), rest.count("\n", 0, match.start()) + 1, language, code))
    return sorted(found, key=lambda block: block.line)


def every(language: str) -> list[Block]:
    return [block for page in PAGES for block in blocks(page) if block.language == language]


def prose(page: Path) -> str:
    """The text of a page, as it is read: without code, tables, comments and the addresses of links."""
    text = INDENTED.sub("", FENCE.sub("", page.read_text(encoding="utf-8")))
    text = re.sub(
        r"^\|.*$|^:::.*$|^\.\. auto.*$|^   :\w+:.*$", "", re.sub(r"<!--.*?-->", "", text, flags=re.S), flags=re.M
    )
    return re.sub(r"\]\([^)]*\)", "]", text)


def words(page: Path) -> int:
    """How many words of text a page has."""
    return sum(bool(re.search(r"\w", word)) for word in prose(page).split())


def commands() -> Iterator[Command]:
    """Every command of every page: of its blocks of shell, and of its running text."""
    for page in PAGES:
        for block in blocks(page):
            if block.language != "sh" or block.skipped:
                continue
            joined = block.text.replace("\\\n", " ")
            for number, line in enumerate(joined.splitlines()):
                for part in re.split(r"&&|\|", line):
                    words = shlex.split(re.sub(r">.*", "", part), comments=True)
                    if words:
                        where = f"{block.page}:{block.line + number}"
                        yield Command(where, block.page, tuple(words), True, block.in_order)
        text = FENCE.sub(lambda match: "\n" * match[0].count("\n"), page.read_text(encoding="utf-8"))
        for match in SPAN.finditer(text):
            where = f"{name_of(page)}:{text.count(chr(10), 0, match.start()) + 1}"
            words = shlex.split(re.sub(r" > .*", "", " ".join(match[1].split())))
            yield Command(where, name_of(page), tuple(words), False)


def checkout(folder: Path, page: str) -> Path:
    """A copy of the project as a reader of ``page`` has it, with the files that the page shows."""
    folder.mkdir(parents=True)
    for name in ("workflow", "config", "profiles"):
        shutil.copytree(ROOT / name, folder / name)
    for name in ("Snakefile", "constraints.txt", "pyproject.toml"):
        if (ROOT / name).exists():
            shutil.copy(ROOT / name, folder / name)
    shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("*.egg-info"))
    shown = {block.file: block.text for block in blocks(ROOT / page) if block.file}
    for name, text in (BROUGHT | shown).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def run(folder: Path, *words: str, timeout: float = 300) -> subprocess.CompletedProcess[str]:
    """Run ``python`` with ``words`` in a checkout, as its reader would: the folder itself is on Python's path."""
    path = os.pathsep.join((str(folder / "src"), str(folder)))
    env = os.environ | {"PYTHONPATH": path, "PATH": warm_python.path(), "OMP_NUM_THREADS": "1"}
    command = [warm_python.interpreter(), *words]
    return subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, timeout=timeout, check=False)
