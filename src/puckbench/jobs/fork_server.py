"""A server whose templates have imported what jobs import, and fork the process of each job.

Importing NumPy, Numba, pandas, Matplotlib, Open3D and PyTorch takes a job 0.4 to 2.5 s. There are
four kinds of processes:

* The *asking* process, which Snakemake starts for a job (`run_forked`), hands its words,
  environment, folder and standard streams to the server and waits for the exit status. Where no
  server answers (a job by hand, on another node, in a container), it is the job itself.
* The *server* (`serve`) ends with the run that started it. It hands each request to a template.
* A *template* imports what jobs of a kind had to import, before it forks for the next. There is one
  for each setting of the threads, which libraries read as they are imported.
* A *watcher* forks the *job* and waits for it. Where the asking process is gone or interrupted, the
  job is interrupted within a second, and killed if it lives for five more.

Where the watcher or the job is killed, the asking process becomes the job, once: an ordinary
process, whose end is the job's.

Other than the job of an ordinary process, a forked one has umask, limits, niceness and affinity of
the run, not of the process that asked.
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
"""Environment variable: the secret that a run's jobs share with its server."""
_PACKAGES = (
    *("DracoPy", "PIL", "constriction", "llvmlite", "matplotlib", "numba", "numpy", "open3d"),
    *("pandas", "puckbench", "pyarrow", "pydantic", "pydantic_core", "pykdtree", "safetensors"),
    *("scipy", "torch", "yaml"),
)
"""Packages that a template imports. Threads that they start meanwhile, of allocators and of BLAS,
they start anew after a fork. Packages of a user's codec are left to its jobs."""
_BY_ITSELF_S, _GRACE_S = 1.0, 5.0
"""After the asking process is gone or interrupted: seconds for the job to end by itself, as a
terminal interrupts it too, before it is interrupted; then before it is killed."""
_ON_INTERRUPT = signal.getsignal(signal.SIGINT)
"""What the run's processes do at an interrupt: nothing, where a shell runs them in background."""
_GPU = "/dev/nvidiactl"
_DIGEST_BYTES = 32
_STREAMS = 3
_MOST_BYTES = 1 << 17
_BEGUN = b"+"
_FAILED = 1
_INTERRUPTED = 130
_SERVE = "from puckbench.jobs.fork_server import serve; serve({})"
_held: list[IO[bytes]] = []
"""Write ends of standard inputs of servers, which end when this process does."""


def start_fork_server() -> None:
    """Start a server for the jobs of this process's children; it ends with this process.

    Nothing is started where the system is not Linux from version 5.3, nor where there is a GPU:
    what an import says to its driver does not survive a fork.
    """
    import subprocess

    try:
        os.close(os.pidfd_open(os.getpid()))
    except (AttributeError, OSError):
        return
    if os.path.exists(_GPU):  # noqa: PTH110 (a light start)
        return
    os.environ[VARIABLE] = os.urandom(_DIGEST_BYTES // 2).hex()
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
    secret, sources = os.environ[VARIABLE], os.environ.get("PYTHONPATH")
    return "\0puckbench-" + _digest(secret, sources, sys.prefix, sys.version)


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
        The job's exit status; None where no server answers, or the job or its watcher was killed:
        then this process is to be the job.
    """
    if VARIABLE not in os.environ:
        return None
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with socket.socket(socket.AF_UNIX) as server:
        try:
            server.connect(_address())
            job = _begun(words, server) if _is_mine(server) else None
            if job is None:
                return None
            answer = _end_of_job(server)
            if not answer:
                _kill(job)
                print("puckbench: this job was killed, and runs again", file=sys.stderr)  # noqa: T201
        except KeyboardInterrupt:
            return _INTERRUPTED
        except OSError:
            return None
    return answer[0] if answer else None


def _begun(words: Sequence[str], server: socket.socket) -> int | None:
    """A descriptor of the job's process; None where the server does not take the job on."""
    threads = sorted(item for item in os.environ.items() if "THREADS" in item[0])
    key = (os.environ[VARIABLE] + _digest(threads)).encode()
    request = [[*words], os.getcwd(), dict(os.environ)]  # noqa: PTH109 (a light start)
    socket.send_fds(server, [key], [0, 1, 2])
    server.sendall(json.dumps(request).encode() + b"\n")
    _, jobs, _, _ = socket.recv_fds(server, len(_BEGUN), 1)
    return jobs[0] if jobs else None


def _end_of_job(server: socket.socket) -> bytes:
    """The job's exit status as a byte; none where it or its watcher was killed."""
    answer = b""
    with suppress(OSError):
        try:
            answer = server.recv(1)
        except KeyboardInterrupt:  # a terminal interrupts the job as well; it ends first
            answer = bytes([_INTERRUPTED])
            server.shutdown(socket.SHUT_WR)
            answer = server.recv(1) or answer
    return answer


def _kill(job: int) -> None:
    """Kill a job by its process descriptor, so that it writes no files after its watcher died."""
    with suppress(ProcessLookupError):
        signal.pidfd_send_signal(job, signal.SIGKILL)
    select.select([job], [], [])


def serve(listener_number: int) -> None:
    """Hand each job that is asked for to its template, until standard input ends."""
    listener = socket.socket(fileno=listener_number)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: jobs end by it, then the run
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    secret, templates = os.environ[VARIABLE].encode(), dict[bytes, socket.socket]()
    while listener in select.select([listener, sys.stdin], [], [])[0]:
        asking, _ = listener.accept()
        with asking, suppress(OSError):
            key, streams, _, _ = socket.recv_fds(asking, 2 * _DIGEST_BYTES, _STREAMS)
            try:
                known = _is_mine(asking) and key.startswith(secret)
                if known and not _handed_on(asking, streams, templates.get(key)):
                    inherited = (listener, asking, *templates.values())
                    templates[key] = _start_template([each.fileno() for each in inherited], streams)
                    _handed_on(asking, streams, templates[key])
            finally:
                _close(streams)


def _handed_on(asking: socket.socket, streams: list[int], template: socket.socket | None) -> bool:
    """Whether a template was given a request; not if there is none yet, or no longer."""
    try:
        return bool(template and socket.send_fds(template, [b"?"], [asking.fileno(), *streams]))
    except OSError:
        return False


def _start_template(*inherited: Sequence[int]) -> socket.socket:
    """Fork a template, which closes what the server has open; the socket of its requests."""
    here, there = socket.socketpair()
    if os.fork() == 0:
        try:
            here.close()
            _close(chain(*inherited))
            _be_template(there)
        finally:
            os._exit(_FAILED)
    there.close()
    return here


def _close(numbers: Iterable[int]) -> None:
    for number in numbers:
        os.close(number)


class _Request(NamedTuple):
    """A job that is asked for: its words, and what its process shall have."""

    words: list[str]
    folder: str
    environment: dict[str, str]


def _be_template(requests: socket.socket) -> NoReturn:
    """Import what jobs of a kind had to import, and fork for each further one."""
    import gc

    imports, told = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    told.setblocking(False)  # a job does not wait for a template that is gone
    wanted: dict[str, list[str]] = {}
    while True:
        if imports in select.select([requests, imports], [], [])[0]:
            with suppress(ValueError):  # of more modules than a message holds
                job, *modules = json.loads(imports.recv(_MOST_BYTES))
                wanted.setdefault(job, []).extend(modules)
            continue
        _, numbers, _, _ = socket.recv_fds(requests, 1, 1 + _STREAMS)
        if not numbers:
            os._exit(0)
        with socket.socket(fileno=numbers[0]) as asking, suppress(OSError, ValueError):
            try:
                with asking.makefile("rb") as stream:
                    request = _Request(*json.loads(stream.readline()))
                os.environ.clear()
                os.environ.update(request.environment)
                _import(wanted.pop(request.words[0], []))
                gc.freeze()
                sys.stdout.flush()  # what imports said is not the job's
                if os.fork() == 0:
                    requests.close()
                    _attend(asking, request, numbers[1:], told)
            finally:
                _close(numbers[1:])


def _import(modules: Iterable[str]) -> None:
    """Import modules in the order in which a job did; one that fails is left to jobs."""
    import importlib

    for name in modules:
        with suppress(Exception):
            if name not in sys.modules:
                importlib.import_module(name)


def _attend(
    asking: socket.socket, request: _Request, streams: list[int], told: socket.socket
) -> NoReturn:
    """Fork the process of a job, wait for it, answer with its exit status, and end.

    There is no answer for a job that was killed.
    """
    try:
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        job = os.fork()
        if job == 0:
            asking.close()
            _run(request, streams, told)
        _close(streams)
        watched = os.pidfd_open(job)
        with suppress(OSError):  # where nobody asks any more, the job is interrupted below
            socket.send_fds(asking, [_BEGUN], [watched])
        if watched not in select.select([watched, asking.fileno()], [], [])[0]:
            for wait_s, number in ((_BY_ITSELF_S, signal.SIGINT), (_GRACE_S, signal.SIGKILL)):
                if not select.select([watched], [], [], wait_s)[0]:
                    os.kill(job, number)
        status = os.waitstatus_to_exitcode(os.waitpid(job, 0)[1])
        if status >= 0:
            asking.sendall(bytes([status]))
    finally:
        os._exit(_FAILED)  # nobody waits for it


def _run(request: _Request, streams: list[int], told: socket.socket) -> NoReturn:
    """Be the process of a job, as if started for it alone, and tell what it had to import."""
    import traceback

    for number, stream in enumerate(streams):
        os.dup2(stream, number)
    _close(streams)
    before, status = set(sys.modules), _FAILED
    from puckbench.jobs.process import leave, main

    try:
        signal.signal(signal.SIGINT, _ON_INTERRUPT)
        os.chdir(request.folder)
        status = main(request.words)
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)  # noqa: T201
        status = end.code if isinstance(end.code, int) else _FAILED if end.code else 0
    except BaseException:  # noqa: BLE001 (as Python does at the end of a process)
        traceback.print_exc()
    new = [name for name in list(sys.modules) if name not in before]
    modules = [name for name in new if name.partition(".")[0] in _PACKAGES]
    with suppress(OSError):
        told.send(json.dumps([request.words[0], *modules]).encode())
    leave(status)
