"""Work shared by several threads, with the same result whatever their number."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from puckbench.core.environment import allowed_threads

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_threads(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Call `function` for each item in the threads that the process may use.

    The function gains only where it releases Python's global lock, as compiled loops and numpy do.

    Returns
    -------
    list
        The results in the order of the items.
    """
    waiting = list(items)
    threads = min(allowed_threads(), len(waiting))
    if threads < 2:
        return [function(item) for item in waiting]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, waiting))


def few_at_once(function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """The results in the order of the items, as many at once as there are threads.

    They are computed as they are asked for; the last ones may have been for nothing.
    """
    step = allowed_threads()
    for first in range(0, len(items), step):
        yield from in_threads(function, items[first : first + step])
