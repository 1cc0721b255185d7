"""A server on this machine, in the place of one on the Internet."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any


class _Silent(SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        """Say nothing."""


@contextmanager
def served_files(folder: Path) -> Iterator[str]:
    """Yield the address of a server with the files of a folder, which is made."""
    folder.mkdir()
    with _served(partial(_Silent, directory=str(folder))) as address:
        yield address


@contextmanager
def served_answer(answer: bytes) -> Iterator[str]:
    """Yield the address of a server whose answer is always the same bytes, headers included."""

    class Handler(_Silent):
        def do_GET(self) -> None:
            self.wfile.write(answer)

    with _served(Handler) as address:
        yield address


@contextmanager
def _served(handler: Callable[..., BaseHTTPRequestHandler]) -> Iterator[str]:
    running = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=running.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{running.server_address[1]}"
    finally:
        running.shutdown()
        thread.join()
        running.server_close()
