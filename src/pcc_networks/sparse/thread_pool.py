"""A thread pool whose threads keep their working memory from layer to layer.

Allocating memory for each layer would take as long as the arithmetic. Each chunk of rows is
computed by one thread, so that results do not depend on the number of threads.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch
from torch import Tensor

T = TypeVar("T")


class Scratch:
    """Working memory of a thread: float32 buffers with names."""

    def __init__(self) -> None:
        self._buffers: dict[str, Tensor] = {}

    def take(self, name: str, size: int) -> Tensor:
        """Return a buffer of `size` uninitialised floats.

        Later requests with the same name return the same memory.
        """
        buffer = self._buffers.get(name)
        if buffer is None or len(buffer) < size:
            buffer = self._buffers[name] = torch.empty(size, dtype=torch.float32)
        return buffer[:size]


def slices(count: int, size: int) -> list[slice]:
    """Divide the range from 0 to `count` into slices of `size` rows; the last may be shorter."""
    return [slice(first, min(count, first + size)) for first in range(0, count, size)]


class ThreadPool:
    """Threads with working memory.

    Parameters
    ----------
    threads
        Number of threads.
    executor
        The threads; without it, all work is done by the calling thread.
    """

    def __init__(self, threads: int, executor: ThreadPoolExecutor | None = None) -> None:
        self.threads = threads
        self.shared = Scratch()
        self._executor = executor
        self._local = threading.local()

    def map_chunks(self, rows: int, size: int, work: Callable[[slice, Scratch], T]) -> list[T]:
        """Call a function for chunks of rows, in parallel, and return the results in order.

        Parameters
        ----------
        rows
            Total number of rows.
        size
            Number of rows of a chunk.
        work
            Function of the chunk, as a slice of rows, and the working memory of the thread.
        """
        chunks = slices(rows, size)

        def run_chunk(chunk: slice) -> T:
            if not hasattr(self._local, "scratch"):
                self._local.scratch = Scratch()
            with torch.no_grad():  # gradients are on when a thread starts
                return work(chunk, self._local.scratch)

        if self._executor is None or len(chunks) == 1:
            return [run_chunk(chunk) for chunk in chunks]
        return list(self._executor.map(run_chunk, chunks))

    def submit(self, work: Callable[[], T]) -> Callable[[], T]:
        """Start `work()`, and return a function that waits for its result and returns it."""
        if self._executor is None:
            result = work()
            return lambda: result
        return self._executor.submit(work).result


@contextmanager
def thread_pool(threads: int | None = None) -> Iterator[ThreadPool]:
    """Open a thread pool; while it is open, PyTorch itself uses one thread.

    Parameters
    ----------
    threads
        Number of threads, by default that of PyTorch.
    """
    before = torch.get_num_threads()
    threads = threads or before
    torch.set_num_threads(1)
    try:
        # otherwise a thread's first product would use all cores of the machine
        with ThreadPoolExecutor(threads, "sparse", torch.set_num_threads, (1,)) as executor:
            yield ThreadPool(threads, executor if threads > 1 else None)
    finally:
        torch.set_num_threads(before)
