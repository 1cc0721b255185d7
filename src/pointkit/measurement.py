"""Measurement of the time and the peak memory of function calls."""

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
    """Time and memory of a function call.

    Parameters
    ----------
    seconds
        Duration, s.
    peak_mib
        Peak memory, MiB.
    """

    seconds: float
    peak_mib: float

    def plus(self, other: Cost) -> Cost:
        """Return the cost of two successive calls: total time, and the larger peak memory."""
        return Cost(self.seconds + other.seconds, max(self.peak_mib, other.peak_mib))


NO_COST = Cost(0.0, 0.0)


class Measured(NamedTuple, Generic[T]):
    """Result of the last of several equal function calls, with their measured cost.

    Parameters
    ----------
    seconds, least_s, most_s
        Median, minimum and maximum duration of the calls, s.
    peak_mib
        Increase of resident memory from before the call to its peak, MiB; the largest of all calls.
        On Linux, pages of files (mostly code) do not count. With glibc, memory freed by earlier
        calls is first returned to the system, so that its reuse counts.
    """

    result: T
    seconds: float
    peak_mib: float
    least_s: float
    most_s: float

    def costs(self, what: str) -> dict[str, float]:
        """Return the costs as result columns; `what` is the prefix of names, as in ``encode_s``."""
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
    """Call a function several times, and measure the time and memory of each call.

    Parameters
    ----------
    call
        Function without arguments.
    repeats
        Number of calls.
    whole
        Function that returns the total cost of a call, external programs included, given the cost
        in this process.
    each
        Function that is called with the result of every call; its time does not count.

    Returns
    -------
    Measured
        The result of the last call, and the cost.
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


class CostlyResult(Generic[T]):
    """Cache that keeps the last result of a costly call.

    After `of`, the attribute `saved` is the cost of the call that the cache avoided, or zero if the
    call was made.
    """

    def __init__(self) -> None:
        self._key: object = None
        self._result: T
        self._cost = NO_COST
        self.saved = NO_COST

    def of(self, key: object, make: Callable[[], T], reuse: bool = True) -> T:
        """Return the result for a key; call `make` only for a new key, or if `reuse` is false."""
        if reuse and key == self._key:
            self.saved = self._cost
        else:
            made = measured(make)
            self._key, self._result = key, made.result
            self._cost, self.saved = Cost(made.seconds, made.peak_mib), NO_COST
        return self._result


def _reset_peak() -> float:
    # glibc keeps freed memory resident; a call that reuses it would seem to need none.
    with suppress(AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")
    return _peak_mib()


def _peak_mib() -> float:
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        entries = dict(line.split(":", 1) for line in lines)
        peak, files = (int(entries[name].split()[0]) for name in ("VmHWM", "RssFile"))
        return (peak - files) / 1024
    except (OSError, KeyError):
        unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20
