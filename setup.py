"""What pyproject.toml cannot say: a wheel carries the workflow, so that ``expertaug run`` works without a checkout."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

HERE = Path(__file__).parent
# The published costs estimate how long a run takes.
CARRIED = ("Snakefile", "workflow/**/*", "config/**/*", "profiles/**/*", "results/published/*/costs.csv")


class BuildWithWorkflow(build_py):
    """Copies the workflow to expertaug/project of what is built, but not of an editable installation: it is there."""

    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        for source in sorted(path for pattern in CARRIED for path in HERE.glob(pattern) if path.is_file()):
            target = Path(self.build_lib, "expertaug", "project", source.relative_to(HERE))
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, target)


setup(cmdclass={"build_py": BuildWithWorkflow})
