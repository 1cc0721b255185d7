"""The registry of jobs, i.e. of the steps of the benchmark's workflow.

A job is a class with settings and one method, `Job.run`, which reads files and writes files. The
plan of a run provides the settings, and a rule of the workflow provides the paths of the files.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from typing import Any, Self

from pointkit.models import Model, parsed
from pointkit.registry import Registry, trust


class Job(Model):
    """Base class of jobs, whose fields are the settings."""

    @classmethod
    def create(cls, **settings: Any) -> Self:
        """Return a job with checked settings; raise InputError if one is invalid."""
        return cls.of_record(settings, JOBS.name_of(cls))

    @classmethod
    def of_record(cls, record: Any, what: str) -> Self:
        """Return a job with settings from a file, and permit the import of the plug-ins they name.

        Parameters
        ----------
        record
            Dictionary of settings, not yet checked.
        what
            Beginning of the message of the InputError that invalid settings raise.
        """
        job = parsed(cls, record, what)
        trust(job.plugins())
        return job

    def plugins(self) -> Iterable[str | None]:
        """Return the names or places (``file.py:Name``) of the plug-ins that the job uses."""
        return ()

    @abstractmethod
    def run(self, *args: Any, **files: Any) -> dict[str, Any]:
        """Do the work of the job: read the input files, and write the output files.

        If the job fails, no output file is written.

        Parameters
        ----------
        args, files
            Paths of input and output files. Classes name and describe them.

        Returns
        -------
        dict[str, Any]
            Facts about the results, which commands print as JSON.
        """


JOBS: Registry[type[Job]] = Registry("job", "jobs")
