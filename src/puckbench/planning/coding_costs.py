from __future__ import annotations

import math
from functools import cache, cached_property

from puckbench.codecs.budget import MOST_PROBES
from puckbench.codecs.rates import budgets_of
from puckbench.core.environment import thread_environment
from puckbench.planning.costs import costs_of
from puckbench.planning.files import Files

_BYTES_PER_PIXEL = 100
"""Memory per pixel of a square view, bytes (measured: 305 MB for a width of 1920)."""


class CodingCosts:
    """What the rules that run codecs request: memory, time, cores and threads.

    Parameters
    ----------
    files
        Files of the run, with its plan.
    """

    def __init__(self, files: Files) -> None:
        self.files, self.plan = files, files.plan
        self.timing = self.plan.config.timing

    @cached_property
    def _most_points(self) -> int:
        return max((data.points for data in self.plan.datasets.values()), default=0)

    @cache  # noqa: B019 (one plan lives as long as the process)
    def minutes(self, codec: str) -> int:
        """Return the time, in minutes, to request for coding a cloud at all rates of a codec."""
        rates = max((len(self.plan.rates(codec, frame)) for frame in self.plan.frames), default=0)
        seconds = self.timing.repeats * costs_of(self.plan.opened[codec]).seconds_of(
            self._most_points
        )
        probes = MOST_PROBES if budgets_of(self.plan.opened[codec]) else 1
        return 5 + math.ceil(2 * rates * probes * seconds / 60)

    @cache  # noqa: B019
    def memory_mb(self, codec: str) -> int:
        """Return the estimated memory (MB) of a job that codes the largest cloud of the run."""
        of_clouds = max(map(self.files.memory_mb, self.plan.datasets), default=0)
        return max(costs_of(self.plan.opened[codec]).memory_of(self._most_points), of_clouds)

    @cached_property
    def views_mb(self) -> int:
        """Memory (MB) of the largest rendered views of the run."""
        views = max((data.settings.views for data in self.plan.datasets.values()), default=0)
        return views**2 * _BYTES_PER_PIXEL // 1_000_000

    @property
    def threads_environment(self) -> dict[str, str]:
        """Environment variables that limit the threads of a timed job."""
        return thread_environment(self.timing.threads)

    def cores(self, cores: int | None) -> int:
        """Return the number of cores that a timed job reserves.

        `cores` is the number of cores of the run. With the setting ``timing: exclusive``, a job
        reserves all of them, so that no other job runs at the same time.
        """
        threads = self.timing.threads
        return max(threads, cores or 0) if self.timing.exclusive else threads
