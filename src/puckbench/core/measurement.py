"""Time and memory of one call, inside the process, imports and warm-up left out."""

from __future__ import annotations

import ctypes
import gc
import resource
import statistics
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

T = TypeVar("T")


class Cost(NamedTuple):
    """What a call cost: seconds, and peak memory in MiB."""

    seconds: float
    peak_mib: float

    def plus(self, other: Cost) -> Cost:
        """The cost of this call and of another one after it."""
        return Cost(self.seconds + other.seconds, max(self.peak_mib, other.peak_mib))


NO_COST = Cost(0.0, 0.0)


class Measured(NamedTuple, Generic[T]):
    """Result of a call, seconds of its repetitions (median, least, most), peak memory in MiB.

    peak_mib: the most resident memory during a call above what was resident before it, when what
    earlier calls had freed was back with the system (glibc; elsewhere a call may find such memory
    and show less). Pages of files that became resident (on Linux), mostly code of libraries, are
    not counted: a process that was forked has to find them anew.
    """

    result: T
    seconds: float
    peak_mib: float
    least_s: float
    most_s: float

    def costs(self, what: str) -> dict[str, float]:
        """Columns of a result row for ``what`` ("encode"): median, spread, and memory."""
        return {
            f"{what}_s": self.seconds,
            f"{what}_s_min": self.least_s,
            f"{what}_s_max": self.most_s,
            f"{what}_peak_mib": self.peak_mib,
        }


def measured(
    call: Callable[[], T],
    repeats: int = 1,
    whole: Callable[[Cost], Cost] = lambda here: here,
    each: Callable[[T], object] = lambda result: None,
) -> Measured[T]:
    """Run `call` `repeats` times; the result is the last one's.

    whole: the whole cost of a call that has just ended, from its cost in this process. each: gets
    the result of every repetition, outside the measured time.
    """
    seconds, peaks = [], []
    for _ in range(repeats):
        gc.collect()
        before = _reset_peak()
        start = time.perf_counter()
        result = call()
        cost = whole(Cost(time.perf_counter() - start, max(0.0, _peak_mib() - before)))
        seconds.append(cost.seconds)
        peaks.append(cost.peak_mib)
        each(result)
    return Measured(result, statistics.median(seconds), max(peaks), min(seconds), max(seconds))


def _reset_peak() -> float:
    """Set the kernel's high-water mark to the resident size of what is in use, and return it.

    glibc keeps freed memory resident, where a call would find it and seem to need none.
    """
    with suppress(AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return _peak_mib()


def _peak_mib() -> float:
    """The most resident memory so far, less the pages of files that are resident now."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        entries = dict(line.split(":", 1) for line in lines)
        peak, files = (int(entries[name].split()[0]) for name in ("VmHWM", "RssFile"))
        return (peak - files) / 1024
    except (OSError, KeyError):
        unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20
