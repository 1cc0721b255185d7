"""A planned job: what its rule hands over, and by what Snakemake sees that it must run again."""

from __future__ import annotations

from typing import Any, NamedTuple

from puckbench.jobs.registry import JOBS, Job
from puckbench.planning.fingerprints import code_version


class PlannedJob(NamedTuple):
    """The parameters of a rule.

    name: of the job. record: its settings as JSON, for
    ``python -m puckbench.jobs``. code: fingerprint of the
    code that does the work.
    """

    name: str
    record: str
    code: str


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


class JoinedTable(NamedTuple):
    """What is made of many jobs' files; outputs: key of the job -> file, or several."""

    job: PlannedJob
    files: list[str]
    outputs: dict[str, Any]
