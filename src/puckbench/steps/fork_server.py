"""A server process that imports the packages of jobs once, and runs each job in a fork of itself.

This saves the time of imports (NumPy, Numba, PyTorch and others), which is 0.4 to 2.5 s for a job.
Compiled functions that a job has read from their caches, which takes some 0.3 s, are then read by
the server too, for the jobs that follow.

Snakemake starts a *client* process for each job. The client sends its arguments, environment,
working folder and output streams to the *server*, and waits for the exit status of the forked
*job*. If there is no server, or the forked job was killed, the client runs the job itself. There is
no server on another node, in a container, for another number of threads, and if the environment
variable ``PUCKBENCH_FORK_SERVER`` is ``off``.

Client and server are connected by a socket with an abstract address, which is no file. Therefore, a
server that is killed leaves nothing behind.
"""

from __future__ import annotations

import atexit
import importlib
import os
import pkgutil
import signal
import socket
import struct
import sys
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING

from puckbench.core.children import adopt_orphans, end_children
from puckbench.core.interrupts import signal_end
from puckbench.steps.child import INTERRUPTED, SECONDS_TO_END, exit_status

if TYPE_CHECKING:
    import subprocess

VARIABLE = "PUCKBENCH_FORK_SERVER"
"""Environment variable with the name of a run's server, or ``off``."""
MODULES = (
    *("pandas", "pyarrow.parquet", "matplotlib.figure", "matplotlib.backends.backend_agg", "numba"),
    *("scipy.spatial", "pykdtree.kdtree", "open3d", "pointkit", "virtual_lidar", "gpcc", "puck"),
    *("primitive_codec", "cloud_files", "puckbench.recordings", "puckbench.scene_sets"),
    *("puckbench.metrics", "puckbench.codecs", "puckbench.figures", "puckbench.report"),
    *("puckbench.steps", "puckbench.results", "puckbench.tables", "puckbench.published_sources"),
)
"""Names of what a server imports: modules, and packages with all their modules."""
LEARNED = ("torch", "constriction", "pcc_networks")
"""Names of what a server also imports if a run uses learned codecs."""
_GPU = "/dev/nvidiactl"
_LARGEST_REPORT = 1 << 18
"""Number of bytes that a job may report; the system limits it to some 200 kB."""
_FORK = get_context("fork")


def start_fork_server(threads: int, modules: Iterable[str] = MODULES) -> None:
    """Start a server that runs the jobs of this process's child processes.

    The server ends when this process ends, since its standard input closes. No server is started on
    systems other than Linux, on machines with a GPU (whose driver does not survive a fork), or if a
    parent process has started a suitable server already.

    Parameters
    ----------
    threads
        Maximum number of threads of the imported libraries.
    modules
        Names of what the server imports: modules, and packages with all their modules.
    """
    import subprocess
    from pathlib import Path
    from secrets import token_hex

    from puckbench.core.environment import thread_environment

    is_off = os.environ.get(VARIABLE) == "off"
    if is_off or sys.platform != "linux" or Path(_GPU).exists() or is_serving(threads):
        return
    os.environ[VARIABLE] = f"puckbench-{token_hex(8)}"
    program = f"from puckbench.steps.fork_server import serve; serve({tuple(modules)!r})"
    server = subprocess.Popen(
        [sys.executable, "-c", program],
        env={**os.environ, **thread_environment(threads)},
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        start_new_session=True,  # a terminal interrupts the clients, which interrupt their jobs
    )
    atexit.register(_end, server)


def _end(server: subprocess.Popen[bytes]) -> None:
    with server:
        server.kill()


def is_serving(threads: int | None = None) -> bool:
    """Return whether a server accepts jobs with a number of threads.

    With None, the number is that of the environment variable ``OMP_NUM_THREADS``.
    """
    with socket.socket(socket.AF_UNIX) as client:
        return VARIABLE in os.environ and client.connect_ex(address(threads)) == 0


def address(threads: int | None = None) -> str:
    """Return the address of the socket of the server for a number of threads.

    With None, the number is that of the environment variable ``OMP_NUM_THREADS``.
    """
    import hashlib

    number = os.environ.get("OMP_NUM_THREADS") if threads is None else str(threads)
    names = [number, os.environ.get("PYTHONPATH")]
    digest = hashlib.sha256(repr((names, sys.prefix, sys.version)).encode()).hexdigest()
    return f"\0{os.environ[VARIABLE]}/{digest[:16]}"


def _is_of_this_user(peer: socket.socket) -> bool:
    """Return whether the process at the other end belongs to the same user as this one."""
    _, user, _ = struct.unpack("3i", peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return bool(user == os.getuid())


def run_forked(words: Sequence[str]) -> int | None:
    """Run a job in the server, and return the job's exit status.

    If this process must run the job itself, return None. `words` are the arguments of
    ``python -m puckbench.steps``.
    """
    if VARIABLE not in os.environ:
        return None
    job = 0
    try:
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(address())
            if not _is_of_this_user(client):
                return None
            socket.send_fds(client, [b"+"], [1, 2])
            connection = Connection(client.detach())
        connection.send((words, os.getcwd(), dict(os.environ)))  # noqa: PTH109 (a light start)
        job = connection.recv()
        status, has_returned = connection.recv()
        if status >= 0:
            return exit_status(status, has_returned=has_returned)
    except KeyboardInterrupt:
        if job:
            os.kill(job, signal.SIGINT)
            if not connection.poll(SECONDS_TO_END):
                os.kill(job, signal.SIGKILL)
        return INTERRUPTED
    except (OSError, EOFError):
        pass
    if job:
        print("puckbench: this job was killed, and runs again", file=sys.stderr)  # noqa: T201
    return None


def serve(modules: Iterable[str]) -> None:
    """Import modules, then fork a process for each requested job until standard input closes."""
    import gc
    import pickle

    from pointkit.compiling import load_functions
    from pointkit.registry import plugin_packages
    from puckbench.core.packages import ENGINES

    plugins = plugin_packages()
    for name in (*modules, *plugins):
        _import(name, {"puckbench", *ENGINES, *plugins})
    gc.freeze()
    run_ends = sys.stdin.fileno()
    loaded, report = socket.socketpair(type=socket.SOCK_DGRAM)
    report.setblocking(False)  # jobs do not wait for the server
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(address())
        listener.listen()
        while run_ends not in (ready := wait([listener, loaded, run_ends])):
            if loaded in ready:
                with suppress(Exception):  # types of a user's plug-in, which are not here
                    load_functions(pickle.loads(loaded.recv(_LARGEST_REPORT)))  # noqa: S301
                gc.freeze()
                continue
            client, _ = listener.accept()
            with client, suppress(OSError):
                if not _is_of_this_user(client):
                    continue
                _, streams, _, _ = socket.recv_fds(client, 1, 2)
                watched = (client, streams, (listener, loaded), report)
                _FORK.Process(target=_watch, args=watched).start()
                for stream in streams:
                    os.close(stream)


def _import(name: str, ours: Collection[str]) -> None:
    """Import a module and, if it is a package in `ours`, all modules below it."""
    with suppress(Exception):
        folders = getattr(importlib.import_module(name), "__path__", ())
        if name.partition(".")[0] in ours:
            for module in pkgutil.iter_modules(folders, f"{name}."):
                _import(module.name, ours)


def _watch(
    client: socket.socket,
    streams: Sequence[int],
    of_server: Iterable[socket.socket],
    report: socket.socket,
) -> None:
    for each in of_server:
        each.close()
    adopt_orphans()
    connection = Connection(client.detach())
    with suppress(OSError, EOFError):  # the client may have ended
        has_returned, returned = _FORK.Pipe(duplex=False)
        arguments = (connection, returned, report, streams, *connection.recv())
        job = _FORK.Process(target=_run, args=arguments)
        job.start()
        for stream in streams:
            os.close(stream)
        connection.send(job.pid)
        job.join()
        end_children()
        connection.send((job.exitcode, has_returned.poll()))


def _run(
    connection: Connection,
    returned: Connection,
    report: socket.socket,
    streams: Sequence[int],
    words: Sequence[str],
    folder: str,
    environment: dict[str, str],
) -> None:
    import pickle

    from pointkit.compiling import loaded_functions
    from puckbench.steps.process import leave, main

    signal_end(connection.fileno())  # of the client, with which SIGIO ends this process
    for number, stream in enumerate(streams, start=1):
        os.dup2(stream, number)
        os.close(stream)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    already = loaded_functions()
    status = main(words, is_alone=True)
    with suppress(Exception):  # the server may be busy, or types of a user's plug-in are local
        if (loaded := loaded_functions()) != already:
            report.send(pickle.dumps(loaded))
    returned.send_bytes(b"returned")
    leave(status)
