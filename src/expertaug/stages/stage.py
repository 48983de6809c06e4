"""What a stage is: a name, typed settings, a slice of the configuration, the code that it runs, and how it is run."""

from __future__ import annotations

import argparse
import importlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from expertaug.stages.options import read_settings, with_prior

if TYPE_CHECKING:
    from expertaug.config.models import Configuration
    from expertaug.evaluation.products import Product
    from expertaug.settings import Raw, Settings

WHERE = "--settings"
# Stages that others read.
SETS = ("simulate", "split_chunks", "cut_measurements")
HORIZONS = ("cut_horizon", "cut_measured_horizon")
TRAINED = ("train", "alternate", "share")


def _import(name: str) -> Any:
    """What ``package.module:name`` names."""
    module, _, inside = name.partition(":")
    return getattr(importlib.import_module(module), inside)


def to_json(settings: Any) -> str:
    """Settings as the text that a job is given: what stands in it says whether the job is redone."""
    if not isinstance(settings, Mapping):
        settings = settings.model_dump(mode="json", exclude_unset=True)
    return json.dumps(settings, sort_keys=True)


class _Recorder(argparse.ArgumentParser):
    """Keeps what a stage takes.

    Attributes:
        options, others: its arguments by name: those that are options, and those that are none.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.options: dict[str, argparse.Action] = {}
        self.others: dict[str, argparse.Action] = {}

    def add_argument(self, *names: str, **kwargs: Any) -> argparse.Action:
        action = super().add_argument(*names, **kwargs)
        (self.options if action.option_strings else self.others)[action.dest] = action
        return action


class Stage:
    """A stage: its docstring says what it does, a subclass the rest.

    What a stage reads its settings into and computes with is named, and imported when it is needed: the command line
    knows every stage, and a job pays for its own alone.

    Attributes:
        name: of the subcommand.
        former: names that it had; they go with the next version.
        code: the module whose public function does its work: with what it imports, what the workflow watches.
        job: the class of its settings, ``package.module:Class``; empty for a stage that has none.
        slice: the function, ``package.module:name``, that takes the completed configuration and names, and gives the
            settings of one job and nothing more: a changed key redoes only the jobs whose slice has it.
        reads: stages whose files it reads, as rules name them: what the report draws.
        runs_methods: whether it runs classes that the configuration names (a system, an encoder …): their files are
            watched too.
    """

    name: ClassVar[str]
    former: ClassVar[tuple[str, ...]] = ()
    code: ClassVar[str]
    job: ClassVar[str] = ""
    slice: ClassVar[str] = ""
    reads: ClassVar[tuple[str, ...]] = ()
    runs_methods: ClassVar[bool] = False

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        """Add what the subcommand takes beside its settings and its log."""
        raise NotImplementedError

    @staticmethod
    def run(a: argparse.Namespace, job: Any) -> None:
        """Read, call, write; ``job`` are the checked settings."""
        raise NotImplementedError

    @classmethod
    def key(cls) -> str:
        """Its name as rules, logs and targets have it."""
        return cls.name.replace("-", "_")

    @classmethod
    def text(cls) -> str:
        """What it does, as its help says it."""
        return " ".join((cls.__doc__ or "").split())

    @classmethod
    def products(cls) -> tuple[Product, ...]:
        """The tables and figures that it makes for readers: targets of the workflow, and what ``publish`` keeps."""
        return ()

    @classmethod
    def job_of(cls, a: argparse.Namespace, settings: Raw) -> str:
        """The class of its settings; a stage that has several kinds of them chooses here."""
        return cls.job

    @classmethod
    def kind_of(cls, a: argparse.Namespace, settings: Raw) -> type[Settings]:
        """What these settings are read into."""
        return _import(cls.job_of(a, settings))

    @classmethod
    def read(cls, a: argparse.Namespace) -> Settings:
        """The settings that the command line gives, checked.

        Raises:
            InputErrors: a key is missing or unknown, or a value cannot be used: a line for each.
        """
        settings = cls.complete(a, read_settings(a.settings))
        return cls.kind_of(a, settings).from_mapping(settings, WHERE)

    @classmethod
    def complete(cls, a: argparse.Namespace, settings: Raw) -> Raw:
        """The settings with what other options say of them."""
        return settings

    @classmethod
    def execute(cls, a: argparse.Namespace) -> None:
        """Run the stage as a command line says."""
        cls.run(a, cls.read(a) if cls.job else None)

    @classmethod
    def command(cls, places: str, name: str | None = None) -> str:
        """The command line of its jobs as a rule's ``shell``; settings and log are in it by themselves.

        Arguments:
            places: where a rule has what the stage takes, as ``input.model output``: the value of the option of that
                name; where nothing has that name, of a file that is made or of a parameter that of ``--output``; else
                an argument that is no option. A parameter for one value that may be left out is the whole option.
            name: of the subcommand, where jobs choose between several that take the same.

        Raises:
            TypeError: it needs what is not there, or takes no such argument.
        """
        parser = _Recorder(add_help=False)
        cls.add_arguments(parser)
        others, options = [], {}
        for place in places.split():
            kind, _, leaf = place.rpartition(".")
            of_output = kind in ("output", "params") and leaf not in parser.others
            option = leaf if leaf in parser.options else "output" if of_output else None
            if option is None:
                others.append(f"{{{place}:q}}")
            elif option in options or option not in parser.options:
                raise TypeError(f"{cls.name} takes no {place}")
            else:
                action = parser.options[option]
                whole = kind == "params" and not action.required and action.nargs is None
                options[option] = f"{{{place}}}" if whole else f"{action.option_strings[0]} {{{place}:q}}"
        missing = {option for option, action in parser.options.items() if action.required} - options.keys()
        if missing or len(others) != len(parser.others):
            raise TypeError(f"{cls.name} needs {', '.join([*sorted(missing), *parser.others])}, has {places}")
        settings = ["--settings {params.settings:q}"] if cls.job else []
        return " ".join(["expertaug", name or cls.name, *others, *options.values(), *settings, "--log {log:q}"])

    @classmethod
    def settings_of(cls, config: Configuration, *names: str | None) -> str:
        """One job's settings as JSON: what the workflow passes.

        Arguments:
            config: completed.
            names: of the experiment, the version, the group of seeds, the set …, as the stage's slice takes them.
        """
        return to_json(_import(cls.slice)(config, *names))

    @classmethod
    def sources(cls, extra: Iterable[str] = ()) -> list[Path]:
        """Its source files.

        Arguments:
            extra: modules that the configuration names: ``package.module`` or ``package.module:Class``.

        Raises:
            InputError: a module does not exist.
        """
        from expertaug import source_files

        return source_files.files([cls.code, *extra])

    @classmethod
    def software(cls, extra: Iterable[str] = ()) -> list[str]:
        """What computes its numbers: a digest of its source files, and installed versions of packages. The workflow
        redoes the stage when that changes.

        Arguments:
            extra: as of :meth:`sources`.
        """
        from expertaug import source_files

        modules = [cls.code, *extra]
        return [source_files.digest(modules), *source_files.versions(modules)]


class StageWithPrior(Stage):
    """A stage whose p⁺ may have found its own ranges, in a file that the command line names."""

    @classmethod
    def complete(cls, a: argparse.Namespace, settings: Raw) -> Raw:
        return with_prior(a, settings)
