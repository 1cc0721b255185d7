"""Lets scene sets of users run whose members have the names of an earlier version."""

from __future__ import annotations

import sys
from abc import update_abstractmethods
from typing import Any

_NEW_NAMES = {
    "_listed": "listed",
    "_group": "group_of",
    "_source": "source_of",
    "_read": "read_mesh",
    "_takes": "takes",
    "_file": "file_of",
    "_unit": "unit_of",
    "_missing": "missing",
    "_about": "about",
}
"""Members by their old names."""


def keep_old_names(kind: type[Any]) -> None:
    """Give members of a user's class of scene sets, and of its bases, both their names.

    If a class has old members, a line on standard error says what to rename.
    """
    for each in reversed(kind.__mro__[:-1]):
        _keep_old_names_of(each)
        update_abstractmethods(each)


def _keep_old_names_of(kind: Any) -> None:
    own, renamed = dict(vars(kind)), []
    for old, new in _NEW_NAMES.items():
        if new in own and not getattr(own[new], "__isabstractmethod__", False):
            setattr(kind, old, own[new])
        elif old in own and hasattr(kind, new):
            setattr(kind, new, own[old])
            renamed.append(f"{old} is now {new}")
    if renamed:
        line = f"puckbench: scene set {kind.__name__} has old names: {', '.join(renamed)}"
        sys.stderr.write(f"{line}\n")
