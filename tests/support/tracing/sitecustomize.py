"""Python runs this file first in a process whose PYTHONPATH has this folder.

In a process of a job, and in processes that it starts, it appends to the file ``TRACE_FOLDER/PID`` the
files whose functions run (``f``), compiled functions that are loaded (``c``) and the files that are
opened to be read (``r``). Functions that run while a module is imported do not count.
"""

import os
import sys
import threading
from types import CodeType, FrameType

_FOLDER, _JOB = os.environ.get("TRACE_FOLDER"), os.environ.get("TRACE_JOB")
_PACKAGE = "puckbench.jobs"


def _trace(file: str) -> None:
    descriptor = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
    seen, known, inside = set[str](), set[CodeType](), threading.local()

    def note(line: str) -> None:
        if line not in seen:
            seen.add(line)
            os.write(descriptor, f"{line}\n".encode())

    def opened(event: str, arguments: tuple[object, ...]) -> None:
        if event == "open" and isinstance(arguments[0], (str, bytes)):
            path = os.path.abspath(os.fsdecode(arguments[0]))  # noqa: PTH100
            if path.endswith(".nbi"):
                note(f"c {path}")
            elif not int(str(arguments[2] or 0)) & os.O_WRONLY:
                note(f"r {path}")

    def called(frame: FrameType, event: str, _: object) -> object:
        code = frame.f_code
        if code.co_name == "<module>" and frame.f_globals.get("__name__") != "__main__":
            inside.imports = getattr(inside, "imports", 0) + 1
            frame.f_trace_lines = False
            return ended
        if code not in known and not getattr(inside, "imports", 0):
            known.add(code)
            note(f"f {code.co_filename}")
        return None

    def ended(_: FrameType, event: str, __: object) -> object:
        if event == "return":
            inside.imports -= 1
        return ended

    sys.addaudithook(opened)
    threading.settrace(called)
    sys.settrace(called)


if _FOLDER and _JOB is None and _PACKAGE in sys.orig_argv:
    _words = sys.orig_argv[sys.orig_argv.index(_PACKAGE) + 1 :]
    os.environ["TRACE_JOB"] = _JOB = f"{_FOLDER}/{os.getpid()}"
    with open(_JOB, "w", encoding="utf-8") as _file:  # noqa: PTH123
        _file.write(f"j {' '.join(_words[:2])}\n")
if _JOB:
    _trace(_JOB)
