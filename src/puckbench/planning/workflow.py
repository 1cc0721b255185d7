from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from puckbench.core.environment import COMMIT, source_commit
from puckbench.planning.clouds import CloudJobs
from puckbench.planning.coding import CodingJobs
from puckbench.planning.config import trusted
from puckbench.planning.drives import DriveJobs
from puckbench.planning.outputs import OutputJobs
from puckbench.planning.plan import Plan
from puckbench.planning.study import StudyJobs
from puckbench.planning.training import TrainingJobs


class Workflow:
    def __init__(self, config: Mapping[str, Any], check_scenes: bool = False) -> None:
        self.config = trusted(config)
        self.plan = Plan(self.config, check_scenes)
        self.clouds = CloudJobs(self.plan)
        self.coding = CodingJobs(self.clouds)
        self.study = StudyJobs(self.plan)
        self.drives = DriveJobs(self.plan)
        self.training = TrainingJobs(self.plan)
        self.outputs = OutputJobs(self.plan, self.coding, self.drives)


def run_jobs_with(source: str) -> None:
    """Set the environment of jobs: this Python, the source folder `source`, and its commit."""
    for name, first in (("PATH", str(Path(sys.executable).parent)), ("PYTHONPATH", source)):
        paths = [first, *os.environ.get(name, "").split(os.pathsep)]
        os.environ[name] = os.pathsep.join(dict.fromkeys(filter(None, paths)))
    os.environ.pop(COMMIT, None)
    os.environ[COMMIT] = source_commit()


def package_alone(folder: Path) -> Path:
    """Make a folder with a link to puckbench only, for jobs to import; return its path."""
    package, link = Path(__file__).parents[1], folder.resolve() / "puckbench"
    if not link.is_symlink() or link.readlink() != package:
        link.parent.mkdir(parents=True, exist_ok=True)
        new = link.with_name(f"{link.name}.{os.getpid()}")
        new.symlink_to(package)
        new.replace(link)  # atomic, since several jobs may do it at the same time
    return link.parent
