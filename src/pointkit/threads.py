"""Parallel calls of a function in threads, with results in the order of the arguments."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class _Thread(threading.local):
    is_one_of_several = False


_THREAD = _Thread()


def allowed_threads() -> int:
    """Return how many threads to use: ``OMP_NUM_THREADS`` if set, otherwise the number of cores."""
    limit = os.environ.get("OMP_NUM_THREADS", "").split(",")[0]
    return int(limit) if limit.isdigit() else _cores()


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_threads(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Call a function for each item in parallel, and return the results in the order of the items.

    Only a function that releases Python's interpreter lock runs faster this way. Calls of
    `in_threads` by the function itself use no further threads.
    """
    queue = list(items)
    threads = min(allowed_threads(), len(queue))
    if threads < 2 or _THREAD.is_one_of_several:
        return [function(item) for item in queue]
    with ThreadPoolExecutor(threads, initializer=_mark) as pool:
        return list(pool.map(function, queue))


def _mark() -> None:
    _THREAD.is_one_of_several = True


def few_at_once(function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """Call a function for items in parallel batches, and yield the results in order.

    A batch has one item for each thread. A caller that stops early therefore wastes at most one
    batch.
    """
    step = allowed_threads()
    for first in range(0, len(items), step):
        yield from in_threads(function, items[first : first + step])
