"""A planned job: what its rule hands over, and by what Snakemake sees that it must run again."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from puckbench.core.files import write_bytes
from puckbench.jobs.registry import JOBS, Job
from puckbench.planning.fingerprints import code_version

RECORDS = Path(".snakemake", "records")
"""Folder of the records of planned jobs."""


class PlannedJob(NamedTuple):
    """What a rule hands to a job.

    name: of the job. record: its settings as JSON, for ``python -m puckbench.jobs``. code:
    fingerprint of the code that does the work.
    """

    name: str
    record: str
    code: str

    def file(self) -> str:
        """Write the record, if it is not there, and return its file, named after its content."""
        digest = hashlib.sha256(self.record.encode()).hexdigest()[:16]
        path, content = RECORDS / f"{self.name}-{digest}.json", self.record.encode()
        if not path.exists() or path.read_bytes() != content:
            write_bytes(path, content)
        return str(path)


def planned(record: Job, *modules: str, also: object = "") -> PlannedJob:
    """Plan a job.

    Parameters
    ----------
    record
        Its settings.
    modules
        Modules of the plug-ins that do the work, beside the job's own.
    also
        What else the result depends on and the settings do not tell: content of files, say.
    """
    code = code_version(type(record).__module__, *modules)
    name = JOBS.name_of(type(record))
    return PlannedJob(
        name, record.model_dump_json(exclude_defaults=True), f"{code} {also}".rstrip()
    )


class Gathering(NamedTuple):
    """A job that gathers files of many others, named below the results folder."""

    job: PlannedJob
    names: Sequence[str]

    def files(self, results: Path) -> list[str]:
        """The files."""
        return [f"{results}/{name}" for name in self.names]


def results_folder(files: Sequence[str], names: Sequence[str], results: Path) -> str:
    """The folder below which files have these names: the results folder, or a copy of it.

    Snakemake copies files of a store before it runs a job.
    """
    return str(files[0]).removesuffix(f"/{names[0]}") if names else str(results)
