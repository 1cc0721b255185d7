from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from pointkit.files import write_bytes
from puckbench.jobs.registry import JOBS, Job
from puckbench.planning.fingerprints import code_version

RECORDS = Path(".snakemake", "records")
"""Folder for the settings of planned jobs."""


class PlannedJob(NamedTuple):
    """A job's settings as JSON (`record`), the modules with its code, and other data (`also`).

    Snakemake repeats the job if its settings or its fingerprint (`code`) change.
    """

    name: str
    record: str
    modules: tuple[str, ...]
    also: str = ""

    @property
    def code(self) -> str:
        """Fingerprint of the modules, with all that they import, and of the other data."""
        return f"{code_version(*self.modules)} {self.also}".rstrip()

    @property
    def key(self) -> str:
        """The job's name, and a digest of its settings and code."""
        digest = hashlib.sha256(f"{self.record}\n{self.code}".encode()).hexdigest()[:16]
        return f"{self.name}-{digest}"

    @property
    def path(self) -> Path:
        """Path of the file with the settings, named after the job's key."""
        return RECORDS / f"{self.key}.json"

    def file(self) -> str:
        """Write the settings to their file, and return its path."""
        path, content = self.path, self.record.encode()
        if not path.exists() or path.read_bytes() != content:
            write_bytes(path, content)
        return str(path)


def planned(record: Job, *modules: str, also: object = "") -> PlannedJob:
    """Plan a job; `also` is further data that affects its result, such as digests of files."""
    settings = record.model_dump_json(exclude_defaults=True)
    name, own = JOBS.name_of(type(record)), type(record).__module__
    places = (str(Path(each).absolute()) if each.endswith(".py") else each for each in modules)
    return PlannedJob(name, settings, (own, *places), str(also))


class Gathering(NamedTuple):
    """A job that reads files of many other jobs; `names` are relative to the results folder."""

    job: PlannedJob
    names: Sequence[str]

    def files(self, results: Path) -> list[str]:
        return [f"{results}/{name}" for name in self.names]

    def folder(self, files: Sequence[str], results: Path) -> str:
        """Return the results folder, or the copy of it that contains `files`.

        Snakemake makes copies if the results are in remote storage.
        """
        return str(files[0]).removesuffix(f"/{self.names[0]}") if self.names else str(results)
