"""Runs jobs, and tells which code ran and which files were opened.

``python -m tests.support.traced_jobs < COMMANDS`` runs each command (the words after ``python -m
puckbench.steps``) in a fork of its own, and prints a list of `Traced` as JSON.
"""

from __future__ import annotations

import json
import os
import re
import sys
from cProfile import Profile
from importlib import import_module
from multiprocessing import get_context
from types import CodeType
from typing import Any, TypedDict

from puckbench.steps.fork_server import LEARNED, MODULES
from puckbench.steps.process import main as run

_OF_IMPORTS = {"<built-in method builtins.exec>", "<built-in method builtins.__build_class__>"}
"""Functions that run the code of modules and classes."""
_COMPILED = re.compile(r"(.*)/__pycache__/numba-[^/]+/([^/.]+)\.[^/]*\.nbi")


class Traced(TypedDict):
    """What a job did: source files whose functions ran, and files that it opened to read."""

    status: int
    ran: list[str]
    opened: list[str]


def _traced(words: list[str]) -> Traced:
    opened = set[str]()

    def note(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(arguments[0], str | bytes):
            is_read = not (arguments[2] or 0) & os.O_WRONLY
            opened.update([os.path.abspath(os.fsdecode(arguments[0]))] * is_read)  # noqa: PTH100

    sys.addaudithook(note)
    profile = Profile()
    status = profile.runcall(run, words)
    compiled = {f"{found[1]}/{found[2]}.py" for path in opened if (found := _COMPILED.match(path))}
    return {
        "status": status,
        "ran": sorted(compiled | _files(profile)),
        "opened": sorted(path for path in opened if "__pycache__" not in path),
    }


def _files(profile: Profile) -> set[str]:
    """Return the files of functions that `run` called, except while modules were imported."""
    calls = {entry.code: [each.code for each in entry.calls or ()] for entry in profile.getstats()}
    reached, queue = set[CodeType | str](), [run.__code__]
    while queue:
        code = queue.pop()
        is_import = code in _OF_IMPORTS or getattr(code, "co_name", "") == "<module>"
        if code not in reached and not is_import:
            reached.add(code)
            queue += calls.get(code, [])
    # Generators of imports and of jobs have the same callers: functions like `any`.
    functions = (code for code in reached if isinstance(code, CodeType))
    return {code.co_filename for code in functions if code.co_name != "<genexpr>"}


def main() -> None:
    """Run the commands of standard input."""
    for module in (*MODULES, *LEARNED):
        import_module(module)
    commands, traced = json.load(sys.stdin), []
    printed, sys.stdout = sys.stdout, sys.stderr
    for words in commands:
        with get_context("fork").Pool(1) as pool:
            traced.append(pool.apply(_traced, (words,)))
    json.dump(traced, printed)


if __name__ == "__main__":
    main()
