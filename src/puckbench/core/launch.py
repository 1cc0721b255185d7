"""Small program that runs a command under limits, and prints the command's time and memory.

    python -I -S launch.py MEMORY_BYTES SECONDS COMMAND [ARGUMENT ...]

Standard output gets a JSON object with ``seconds``, ``peak_kib`` (peak memory in KiB) and
``status`` (exit status, or minus the number of the signal that ended the command). The command's
own output goes to standard error. The command is killed when standard input, a pipe, closes.

This is a program of its own since the kernel counts the memory of the process that starts a command
as the command's. If the benchmark started it, the peak would include the benchmark's clouds.
"""

import fcntl
import json
import os
import resource
import select
import signal
import sys
import time


def main() -> None:
    memory, seconds, *command = sys.argv[1:]
    resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    start = time.perf_counter()
    actions = [(os.POSIX_SPAWN_DUP2, 2, 1)]
    child = os.posix_spawnp(command[0], command, os.environ, file_actions=actions)
    for number in (signal.SIGALRM, signal.SIGIO):
        signal.signal(number, lambda *_: os.kill(child, signal.SIGKILL))
    signal.alarm(int(seconds))
    fcntl.fcntl(0, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(0, fcntl.F_SETFL, os.O_ASYNC)  # SIGIO when it closes
    if select.select([0], [], [], 0)[0]:
        signal.raise_signal(signal.SIGIO)
    _, status, usage = os.wait4(child, 0)
    cost = {
        "seconds": time.perf_counter() - start,
        "peak_kib": usage.ru_maxrss // (1024 if sys.platform == "darwin" else 1),
        "status": os.waitstatus_to_exitcode(status),
    }
    sys.stdout.write(json.dumps(cost))


if __name__ == "__main__":
    main()
