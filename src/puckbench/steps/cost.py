from __future__ import annotations

import json
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator

from pointkit.files import json_of, text_end
from pointkit.models import Model, parsed

BEGIN = '{"job": '
"""Beginning of the last line in the log of a job that succeeded."""
_TAIL_BYTES = 2048


def cost_line(name: str, key: str) -> str:
    """Return one line of JSON with the time and memory that this process took for a job.

    Child processes are included. Imports in the server that forked this process are not.

    Parameters
    ----------
    name
        Name of the job in the registry `JOBS`.
    key
        Text that identifies the job's settings and code (`puckbench.planning.provenance`).
    """
    import resource

    from puckbench.core.environment import source_commit

    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cost = {
        "job": name,
        "key": key,
        "processor_s": round(sum(use.ru_utime + use.ru_stime for use in usages), 3),
        "wall_s": round(_age_s(), 3),
        "peak_mib": max(use.ru_maxrss for use in usages) // 1024,
        "ended": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    commit = source_commit()
    return json.dumps(cost | ({"commit": commit} if commit else {}))


def _moment(text: str | None) -> str | None:
    if text is not None:
        datetime.fromisoformat(text)
    return text


def _age_s() -> float:
    try:
        fields = Path("/proc/self/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        uptime = float(Path("/proc/uptime").read_text(encoding="ascii").split()[0])
    except OSError:
        return time.process_time()
    import os

    return uptime - int(fields[19]) / os.sysconf("SC_CLK_TCK")


class _Cost(Model, extra="ignore"):
    job: str
    key: str = ""
    processor_s: float
    wall_s: float
    peak_mib: int = 0
    ended: Annotated[str | None, AfterValidator(_moment)] = None
    commit: str = ""


def read_cost(log: Path) -> dict[str, Any] | None:
    """Return the content of the cost line at the end of a log, by key of the line's JSON.

    If the job failed or has not finished, return None.
    """
    last = text_end(log, _TAIL_BYTES).rpartition("\n")[2]
    _, begin, rest = last.partition(BEGIN)  # a plug-in may print before it, without a line break
    if not begin:
        return None
    cost: dict[str, Any] = json_of((begin + rest).encode(), str(log))
    parsed(_Cost, cost, str(log))
    return cost


def read_costs(logs: Path) -> Iterator[dict[str, Any]]:
    """Yield the cost, as from `read_cost`, of each job that succeeded and has a log in a folder."""
    for log in sorted(logs.rglob("*.log")):
        if cost := read_cost(log):
            yield cost
