"""The registry of jobs, which have settings and one method, `Job.run`.

The plan provides the settings; the workflow's rule provides the files.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from typing import Any, Self

from pointkit.models import Model, parsed
from pointkit.registry import Registry, trust


class Job(Model):
    @classmethod
    def create(cls, **settings: Any) -> Self:
        return cls.of_record(settings, JOBS.name_of(cls))

    @classmethod
    def of_record(cls, record: Any, what: str) -> Self:
        """Create a job from settings and trust its plug-ins; error messages begin with `what`."""
        job = parsed(cls, record, what)
        trust(job.plugins())
        return job

    def plugins(self) -> Iterable[str | None]:
        return ()

    @abstractmethod
    def run(self, *args: Any, **files: Any) -> dict[str, Any]:
        """Read the inputs, write either all outputs or none, and return the values to print."""


JOBS: Registry[type[Job]] = Registry("job", "jobs")
