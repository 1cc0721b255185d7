"""Work that several threads share, with the same result whatever their number."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from puckbench.core.environment import allowed_threads

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_threads(function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Results of `function` for each item, in their order, from as many threads as are allowed.

    What takes long in it has to leave Python's lock, as compiled functions and numpy's do.
    """
    waiting = list(items)
    threads = min(allowed_threads(), len(waiting))
    if threads < 2:
        return [function(item) for item in waiting]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, waiting))
