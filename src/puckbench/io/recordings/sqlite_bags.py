"""ROS 2 bags in SQLite (.db3), read without trust in their schema."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError

BESIDE = ("-wal", "-journal")
"""Ends of the names of files beside a database that has changes in them."""
_TABLES = ("topics", "messages")
_STEP = 10_000
_LEAST_STEPS, _STEPS_PER_BYTE = 10_000_000, 100
"""Instructions of SQLite's machine that reading may take: a row takes about twenty."""

Topics = dict[str, str]
StoredMessages = Iterator[tuple[str, bytes]]


@contextmanager
def sqlite_storage(path: Path, folder: Path, kind: str) -> Iterator[tuple[Topics, StoredMessages]]:
    """Open a database: the types of its topics, and topic and bytes of each message of one type.

    Parameters
    ----------
    path
        The database. What is in its write-ahead log or its journal counts as SQLite has it.
    folder
        For copies of databases that have such files beside them, which reading changes.
    kind
        Type of the messages that are read, in the order in which they were recorded.

    Raises
    ------
    InputError
        Its topics and messages are no plain tables.
    apsw.Error
        It is damaged, or reading it takes more steps than its size allows.
    """
    with closing(_connection(path, folder)) as database:
        _check_tables(database)
        topics = dict(database.execute("SELECT name, type FROM topics"))
        query = (
            "SELECT topics.name, messages.data FROM messages JOIN topics"
            " ON messages.topic_id = topics.id WHERE topics.type = ? ORDER BY messages.timestamp"
        )
        yield topics, _checked(database.execute(query, (kind,)))


def _connection(path: Path, folder: Path) -> Any:
    """A connection that changes no file of the user's, takes no views, triggers or extensions from
    the database, and ends after a number of steps."""
    import apsw

    beside = [path.with_name(path.name + end) for end in BESIDE]
    changes = [file for file in beside if file.is_file() and file.stat().st_size]
    if changes:
        name, flags = str(_copied(path, changes, folder)), apsw.SQLITE_OPEN_READWRITE
    else:
        name = f"{path.absolute().as_uri()}?immutable=1"
        flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
    database = apsw.Connection(name, flags=flags)
    database.config(apsw.SQLITE_DBCONFIG_DEFENSIVE, 1)
    for power in ("TRUSTED_SCHEMA", "ENABLE_VIEW", "ENABLE_TRIGGER", "ENABLE_LOAD_EXTENSION"):
        database.config(getattr(apsw, f"SQLITE_DBCONFIG_{power}"), 0)
    size = sum(file.stat().st_size for file in (path, *changes))
    left = iter(range((_LEAST_STEPS + _STEPS_PER_BYTE * size) // _STEP))
    database.set_progress_handler(lambda: next(left, None) is None, _STEP)
    return database


def _copied(path: Path, changes: list[Path], folder: Path) -> Path:
    place = folder / f"{len(list(folder.iterdir()))}.db3"
    shutil.copyfile(path, place)
    for file in changes:
        shutil.copyfile(file, place.with_name(place.name + file.name.removeprefix(path.name)))
    return place


def _check_tables(database: Any) -> None:
    """Refuse views, virtual tables, and tables with computed columns."""
    for table in _TABLES:
        kinds = database.execute(
            "SELECT type, rootpage > 0 FROM sqlite_schema WHERE lower(name) = ?", (table,)
        ).fetchall()
        hidden = database.execute("SELECT max(hidden) FROM pragma_table_xinfo(?)", (table,))
        if kinds != [("table", 1)] or hidden.fetchall() != [(0,)]:
            raise InputError(f"not a ROS bag: the database has no plain table {table}")


def _checked(rows: Any) -> StoredMessages:
    for topic, data in rows:
        if not isinstance(data, bytes):
            raise ValueError("a message that is not binary")
        yield str(topic), data
