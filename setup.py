"""The wheel has the workflow within the package, so that `puckbench run` needs no repository."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

CACHES = shutil.ignore_patterns("__pycache__", "*.py[cod]", ".*")


class WithWorkflow(build_py):
    """Copies `workflow/` to `puckbench/workflow/`; an editable installation finds the folder."""

    def run(self) -> None:
        """Build the package, then put the workflow into it."""
        super().run()
        if not self.editable_mode:
            target = Path(self.build_lib) / "puckbench" / "workflow"
            shutil.copytree("workflow", target, ignore=CACHES, dirs_exist_ok=True)
            # Its rules name this file, whose content Snakemake keeps with what they made.
            (envs := target.with_name("envs")).mkdir(exist_ok=True)
            shutil.copy("envs/puckbench.yaml", envs)


setup(cmdclass={"build_py": WithWorkflow})
