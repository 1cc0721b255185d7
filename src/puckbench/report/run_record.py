from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Annotated, Any

from pydantic import BeforeValidator

from pointkit.models import Model, parsed


def _moment_of(value: Any) -> Any:
    return datetime.fromisoformat(value) if isinstance(value, str) else value


Moment = Annotated[datetime | None, BeforeValidator(_moment_of)]


class RunRecord(Model):
    """Date, duration and commits of a run, computed from the logs of its jobs.

    Parameters
    ----------
    jobs
        Number of jobs.
    processor_s
        Processor time of all jobs, in s.
    began, ended
        When the first job began, and when the last one ended; None if unknown.
    busy_s
        Time during which at least one job ran, in s. It excludes pauses between interrupted runs.
    commits
        Commits of puckbench's sources that the jobs ran, in the order of their first jobs.
    """

    jobs: int = 0
    processor_s: float = 0.0
    began: Moment = None
    ended: Moment = None
    busy_s: float = 0.0
    commits: tuple[str, ...] = ()

    @classmethod
    def of(cls, costs: Iterable[Mapping[str, Any]]) -> RunRecord:
        """Compute the record from the costs of all jobs (`puckbench.steps.cost`)."""
        all_costs = list(costs)
        dated = sorted((c for c in all_costs if "ended" in c), key=lambda cost: str(cost["ended"]))
        ends = [datetime.fromisoformat(cost["ended"]).timestamp() for cost in dated]
        spans = [(end - c["wall_s"], end) for end, c in zip(ends, dated, strict=True)]
        commits = [str(cost["commit"]) for cost in dated if cost.get("commit")]
        return cls(
            jobs=len(all_costs),
            processor_s=sum(float(cost["processor_s"]) for cost in all_costs),
            began=datetime.fromtimestamp(min(spans)[0], UTC) if spans else None,
            ended=datetime.fromtimestamp(ends[-1], UTC) if ends else None,
            busy_s=_covered(spans),
            commits=tuple(dict.fromkeys(commits)),
        )

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> RunRecord:
        """Return a record from a JSON object, as `as_json` writes it."""
        return parsed(cls, value, "record")

    def as_json(self) -> dict[str, Any]:
        """Return the record as a JSON object."""
        moments = {
            name: moment.isoformat(timespec="seconds") if moment else None
            for name, moment in (("began", self.began), ("ended", self.ended))
        }
        return {**vars(self), **moments, "commits": list(self.commits)}

    def facts(self) -> dict[str, str]:
        """Return the record as texts for the page, by name; empty if there are no jobs."""
        if not self.jobs:
            return {}
        jobs = "1 job" if self.jobs == 1 else f"{self.jobs:,} jobs"
        work = f"{duration_text(self.processor_s)} of processor time in {jobs}"
        facts = {"Date": self._date(), "Duration": work, "Commit": ", ".join(self.commits)}
        if self.ended:
            facts["Duration"] = f"{duration_text(self.busy_s)}, {work}"
        return {name: text for name, text in facts.items() if text}

    def _date(self) -> str:
        if self.began is None or self.ended is None:
            return ""
        first, last = date_text(self.began), date_text(self.ended)
        return last if first == last else f"{first} to {last}"


def _covered(spans: Sequence[tuple[float, float]]) -> float:
    total, reached = 0.0, float("-inf")
    for start, end in sorted(spans):
        total += max(0.0, end - max(start, reached))
        reached = max(reached, end)
    return total


def date_text(moment: datetime) -> str:
    """Return a date in English, such as "3 May 2026"."""
    return f"{moment.day} {moment:%B %Y}"


def duration_text(seconds: float) -> str:
    """Return a duration in one or two units, such as "48 s", "14 min" or "3 h 20 min"."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"
