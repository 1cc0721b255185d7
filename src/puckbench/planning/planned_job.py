from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from pointkit.files import write_bytes
from puckbench.jobs.registry import JOBS, Job
from puckbench.planning.fingerprints import code_version

RECORDS = Path(".snakemake", "records")
"""Folder of the files with the settings of planned jobs."""


class PlannedJob(NamedTuple):
    """A job of the workflow, with all that decides whether it must run again.

    Snakemake repeats the job if `record` or `code` change.

    Parameters
    ----------
    name
        Name of the job's class in the registry `JOBS`.
    record
        The job's settings, as JSON.
    modules
        Names of the modules, or paths of the user's files, whose code makes the results.
    also
        Other data on which the results depend, such as digests of input files.
    """

    name: str
    record: str
    modules: tuple[str, ...]
    also: str = ""

    @property
    def code(self) -> str:
        """Text that changes if the code in `modules`, or the data `also`, change.

        What counts as the code of a module is told in `puckbench.planning.fingerprints`.
        """
        return f"{code_version(*self.modules)} {self.also}".rstrip()

    @property
    def key(self) -> str:
        """The job's name with a digest of its settings and code, by which logs tell what ran."""
        digest = hashlib.sha256(f"{self.record}\n{self.code}".encode()).hexdigest()[:16]
        return f"{self.name}-{digest}"

    @property
    def path(self) -> Path:
        """Path of the file to which `file` writes the settings."""
        return RECORDS / f"{self.key}.json"

    def file(self) -> str:
        """Write the settings to the file `path` if they changed, and return this path as text."""
        path, content = self.path, self.record.encode()
        if not path.exists() or path.read_bytes() != content:
            write_bytes(path, content)
        return str(path)


def planned(record: Job, *modules: str, also: object = "") -> PlannedJob:
    """Plan a job with given settings.

    Parameters
    ----------
    record
        The job with its settings.
    modules
        Names of modules, or paths of the user's files, whose code the job uses besides the module
        that defines it.
    also
        Other data on which the results depend, such as digests of input files.
    """
    settings = record.model_dump_json(exclude_defaults=True)
    name, own = JOBS.name_of(type(record)), type(record).__module__
    places = (str(Path(each).absolute()) if each.endswith(".py") else each for each in modules)
    return PlannedJob(name, settings, (own, *places), str(also))


class Gathering(NamedTuple):
    """A job that joins the files of many other jobs, such as rows of results, into one.

    Parameters
    ----------
    job
        The planned job.
    names
        Paths of its input files, relative to the results folder.
    """

    job: PlannedJob
    names: Sequence[str]

    def files(self, results: Path) -> list[str]:
        """Return the paths of the input files in the results folder."""
        return [f"{results}/{name}" for name in self.names]

    def folder(self, files: Sequence[str], results: Path) -> str:
        """Return the folder to which `names` are relative, as the job sees it.

        If results are in remote storage, Snakemake gives the job local copies of its inputs, so
        that this folder is not `results`.

        Parameters
        ----------
        files
            Paths of the input files, as Snakemake gives them to the job.
        results
            The results folder of the run.
        """
        return str(files[0]).removesuffix(f"/{self.names[0]}") if self.names else str(results)
