"""Pipes, sockets and devices under the names of files: a reader would wait for ever."""

from __future__ import annotations

import os
import socket
from pathlib import Path

from tests.support.corpus_case import Case, Reader

_READERS: dict[str, Reader] = {
    **dict.fromkeys(
        ("ply", "pcd", "las", "laz", "e57", "xyz", "csv", "npy", "npz", "bin", "ply.gz"), "cloud"
    ),
    **dict.fromkeys(("obj", "off", "stl", "glb"), "mesh"),
}


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(os.path.relpath(path))  # paths of sockets are at most 107 bytes


CASES = [
    *(
        Case(f"pipe.{suffix}", os.mkfifo, reader, error=rf"pipe\.{suffix}: a pipe, not a file$")
        for suffix, reader in _READERS.items()
    ),
    Case("socket.ply", _socket, "cloud", error="a socket, not a file$"),
    Case("zero.npy", lambda path: path.symlink_to("/dev/zero"), "cloud", error="a device, not"),
]
