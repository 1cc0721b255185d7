"""A server that has imported what jobs import, and forks the process of each job.

Importing NumPy, Numba, pandas, Matplotlib, Open3D and PyTorch takes a job 0.4 to 2.5 s. What one
job of a kind had to import, its template imports before it forks for the next. There is a template
for each setting of the threads, which libraries read as they are imported. The server ends with
the run that started it. Where none answers (a job by hand, on another node, in a container), a job
is a process of its own.

The process that Snakemake starts for a job (`run_forked`) hands its words, environment, folder and
standard streams to the server and waits for the exit status. If it is killed, so is the job.
"""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import struct
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from itertools import chain
from typing import IO, NamedTuple, NoReturn

VARIABLE = "PUCKBENCH_FORK_SERVER"
"""Environment variable that names the server of a run."""
_PACKAGES = (
    *("DracoPy", "PIL", "constriction", "llvmlite", "matplotlib", "numba", "numpy", "open3d"),
    *("pandas", "puckbench", "pyarrow", "pydantic", "pydantic_core", "pykdtree", "safetensors"),
    *("scipy", "torch", "yaml"),
)
"""Packages that a template imports. Importing them starts no thread that a fork would lose; those
of a user's codec stay in its jobs."""
_SAME_SIGNAL_S, _GRACE_S = 1.0, 5.0
"""Seconds that a job has to end by a signal that the process which asked for it had as well; and to
leave nothing half written when it is interrupted."""
_DIGEST_BYTES = 32
_STREAMS = 3
_MOST_BYTES = 1 << 17
_FAILED = 1
_INTERRUPTED = 130
_SERVE = "from puckbench.jobs.fork_server import serve; serve({})"
_held: list[IO[bytes]] = []
"""The end of the server's standard input, for as long as this process lives."""


def start_fork_server() -> None:
    """Start a server for the jobs of this process's children; it ends with this process.

    Nothing is started where the system is not Linux from version 5.3.
    """
    import subprocess

    try:
        os.close(os.pidfd_open(os.getpid()))
    except (AttributeError, OSError):
        return
    os.environ[VARIABLE] = f"puckbench-{os.urandom(8).hex()}"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(_address())
        listener.listen(socket.SOMAXCONN)
        server = subprocess.Popen(
            [sys.executable, "-c", _SERVE.format(listener.fileno())],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=[listener.fileno()],
        )
    if server.stdin is not None:
        _held.append(server.stdin)


def _address() -> str:
    """Of this run's server, for the same Python: an abstract name of Linux, without a file."""
    name, sources = os.environ[VARIABLE], os.environ.get("PYTHONPATH")
    return "\0" + _digest(name, sources, sys.prefix, sys.version)


def _digest(*items: object) -> str:
    import hashlib

    return hashlib.sha256(repr(items).encode()).hexdigest()[:_DIGEST_BYTES]


def _is_mine(connection: socket.socket) -> bool:
    """Whether a process of the same user is at the other end: abstract names are open to all."""
    form = struct.Struct("3i")
    peer = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, form.size)
    _, user, _ = form.unpack(peer)
    return bool(user == os.getuid())


def run_forked(words: Sequence[str]) -> int | None:
    """Have the server run a job with this process's environment, folder and standard streams.

    Returns
    -------
    int or None
        The job's exit status; None where no server answers.
    """
    if VARIABLE not in os.environ:
        return None
    with socket.socket(socket.AF_UNIX) as server:
        try:
            server.connect(_address())
        except OSError:
            return None
        if not _is_mine(server):
            return None
        threads = sorted(item for item in os.environ.items() if "THREADS" in item[0])
        request = [[*words], os.getcwd(), dict(os.environ)]  # noqa: PTH109 (a light start)
        try:
            socket.send_fds(server, [_digest(threads).encode()], [0, 1, 2])
            server.sendall(json.dumps(request).encode() + b"\n")
            answer = _end_of_job(server)
        except KeyboardInterrupt:
            return _INTERRUPTED
        except OSError:
            answer = b""
    if not answer:
        print("puckbench: the process of this job was lost", file=sys.stderr)  # noqa: T201
        return _FAILED
    return answer[0]


def _end_of_job(server: socket.socket) -> bytes:
    """The job's exit status as a byte; none where its process is lost."""
    try:
        return server.recv(1)
    except KeyboardInterrupt:  # the job mostly has it as well; it ends first
        server.shutdown(socket.SHUT_WR)
        return server.recv(1)


def serve(listener_number: int) -> None:
    """Hand each job that is asked for to its template, until standard input ends."""
    listener = socket.socket(fileno=listener_number)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: jobs end by it, then the run
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    templates: dict[bytes, socket.socket] = {}
    while listener in select.select([listener, sys.stdin], [], [])[0]:
        asking, _ = listener.accept()
        with asking, suppress(OSError):
            if not _is_mine(asking):
                continue
            threads, streams, _, _ = socket.recv_fds(asking, _DIGEST_BYTES, _STREAMS)
            if len(streams) == _STREAMS and not _handed_on(asking, streams, templates.get(threads)):
                inherited = (listener, asking, *templates.values())
                templates[threads] = _start_template([each.fileno() for each in inherited], streams)
                _handed_on(asking, streams, templates[threads])
            for number in streams:
                os.close(number)


def _handed_on(asking: socket.socket, streams: list[int], template: socket.socket | None) -> bool:
    """Whether a template has taken a request; not if there is none yet, or no longer."""
    try:
        return bool(template and socket.send_fds(template, [b"?"], [asking.fileno(), *streams]))
    except OSError:
        return False


def _start_template(*inherited: Sequence[int]) -> socket.socket:
    """Fork a template, which closes what the server has open; where it takes requests."""
    here, there = socket.socketpair()
    if os.fork() == 0:
        try:
            here.close()
            for number in chain(*inherited):
                os.close(number)
            _be_template(there)
        finally:
            os._exit(_FAILED)
    there.close()
    return here


class _Request(NamedTuple):
    """A job that is asked for: its words, and what its process shall have."""

    words: list[str]
    folder: str
    environment: dict[str, str]
    streams: list[int]

    def close(self) -> None:
        for number in self.streams:
            os.close(number)


def _be_template(requests: socket.socket) -> NoReturn:
    """Import what jobs of a kind had to import, and fork for each further one."""
    import gc

    imports, told = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    told.setblocking(False)  # a job does not wait for a template that is gone
    wanted: dict[str, list[str]] = {}
    while True:
        if imports in select.select([requests, imports], [], [])[0]:
            job, *modules = json.loads(imports.recv(_MOST_BYTES))
            wanted.setdefault(job, []).extend(modules)
            continue
        _, numbers, _, _ = socket.recv_fds(requests, 1, 1 + _STREAMS)
        if not numbers:
            os._exit(0)
        with socket.socket(fileno=numbers[0]) as asking, suppress(OSError, ValueError):
            with asking.makefile("rb") as stream:
                words, folder, environment = json.loads(stream.readline())
            request = _Request(words, folder, environment, numbers[1:])
            os.environ.clear()
            os.environ.update(request.environment)
            _import(wanted.pop(request.words[0], []))
            gc.freeze()
            if os.fork() == 0:
                try:
                    requests.close()
                    _attend(asking, request, told)
                finally:
                    os._exit(_FAILED)
            request.close()


def _import(modules: Iterable[str]) -> None:
    """Import modules in the order in which a job did; one that fails is left to jobs."""
    import importlib

    for name in modules:
        with suppress(Exception):
            if name == "open3d":
                from puckbench.core.open3d_library import open3d

                open3d()
            elif name not in sys.modules:
                importlib.import_module(name)


def _attend(asking: socket.socket, request: _Request, told: socket.socket) -> NoReturn:
    """Fork the process of a job, answer with its exit status, and end.

    Where the process that asks is gone or interrupted before, so is the job: by the same signal,
    else after a while by one of its own, and by SIGKILL at last.
    """
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    job = os.fork()
    if job == 0:
        asking.close()
        _run(request, told)
    request.close()
    watched = os.pidfd_open(job)
    if watched not in select.select([watched, asking.fileno()], [], [])[0]:
        for wait_s, number in ((_SAME_SIGNAL_S, signal.SIGINT), (_GRACE_S, signal.SIGKILL)):
            if not select.select([watched], [], [], wait_s)[0]:
                os.kill(job, number)
    status = os.waitstatus_to_exitcode(os.waitpid(job, 0)[1])
    with suppress(OSError):
        asking.sendall(bytes([status if status >= 0 else 128 - status]))
    os._exit(0)


def _run(request: _Request, told: socket.socket) -> NoReturn:
    """Be the process of a job, as if started for it alone, and tell what it had to import."""
    import traceback

    before, status = set(sys.modules), _FAILED
    for number, stream in enumerate(request.streams):
        os.dup2(stream, number)
    request.close()
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.chdir(request.folder)
        from puckbench.jobs.process import main

        status = main(request.words)
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else _FAILED
    except BaseException:  # noqa: BLE001 (as Python does at the end of a process)
        traceback.print_exc()
    new = [name for name in sys.modules if name not in before]
    modules = [name for name in new if name.partition(".")[0] in _PACKAGES]
    with suppress(OSError):
        told.send(json.dumps([request.words[0], *modules]).encode())
    from puckbench.jobs.process import leave

    leave(status)
