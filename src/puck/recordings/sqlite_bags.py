"""Reader of ROS 2 bags in SQLite databases (.db3), whose schemas are not trusted."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from pointkit.errors import InputError
from puck.recordings.topics import BagFile, Topics, added_up

SIDE_FILE_SUFFIXES = ("-wal", "-journal")
"""Suffixes of files that hold changes not yet in the database file."""
_TABLES = ("topics", "messages")
_CHECK_INTERVAL = 10_000
_MIN_STEPS, _STEPS_PER_BYTE = 10_000_000, 100
"""SQLite instructions allowed for a file, and more for each byte. A row takes about twenty."""

_KINDS = "SELECT type, rootpage > 0 FROM sqlite_schema WHERE lower(name) = ?"
_ROWS = (
    "SELECT messages.rowid FROM messages JOIN topics ON messages.topic_id = topics.id"
    " WHERE topics.name = ? ORDER BY messages.timestamp, messages.rowid"
)


@contextmanager
def sqlite_bag(path: Path, folder: Path) -> Iterator[BagFile]:
    """Open a bag, and yield its topics and the function that reads messages.

    A database with side files (write-ahead log, journal) is copied to `folder`, because reading
    changes side files. If the file is damaged, or needs too many SQLite instructions, apsw.Error is
    raised.
    """
    with closing(_connection(path, folder)) as database:
        _check_tables(database)
        topics = _topics(database)
        yield BagFile(topics, lambda topic, numbers: _messages(database, topic, numbers))


def _topics(database: Any) -> Topics:
    query = "SELECT topic_id, count(*) FROM messages GROUP BY topic_id"
    counts = dict(database.execute(query))
    rows = database.execute("SELECT id, name, type FROM topics")
    return added_up((str(name), str(kind), counts.get(key, 0)) for key, name, kind in rows)


def _messages(database: Any, topic: str, numbers: Sequence[int] | None) -> Iterator[bytes]:
    rows = [row for (row,) in database.execute(_ROWS, (topic,))]
    for number in range(len(rows)) if numbers is None else numbers:
        if number >= len(rows):
            return
        ((data,),) = database.execute("SELECT data FROM messages WHERE rowid = ?", (rows[number],))
        if not isinstance(data, bytes):
            raise ValueError("a message that is not binary")
        yield data


def _connection(path: Path, folder: Path) -> Any:
    import apsw

    side_files = [path.with_name(path.name + suffix) for suffix in SIDE_FILE_SUFFIXES]
    changes = [file for file in side_files if file.is_file() and file.stat().st_size]
    if changes:
        name, flags = str(_copied(path, changes, folder)), apsw.SQLITE_OPEN_READWRITE
    else:
        name = f"{path.absolute().as_uri()}?immutable=1"
        flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
    database = apsw.Connection(name, flags=flags)
    database.config(apsw.SQLITE_DBCONFIG_DEFENSIVE, 1)
    for feature in ("TRUSTED_SCHEMA", "ENABLE_VIEW", "ENABLE_TRIGGER", "ENABLE_LOAD_EXTENSION"):
        database.config(getattr(apsw, f"SQLITE_DBCONFIG_{feature}"), 0)
    size = sum(file.stat().st_size for file in (path, *changes))
    checks = iter(range((_MIN_STEPS + _STEPS_PER_BYTE * size) // _CHECK_INTERVAL))
    database.set_progress_handler(lambda: next(checks, None) is None, _CHECK_INTERVAL)
    return database


def _copied(path: Path, changes: list[Path], folder: Path) -> Path:
    copy = folder / f"{len(list(folder.iterdir()))}.db3"
    shutil.copyfile(path, copy)
    for file in changes:
        shutil.copyfile(file, copy.with_name(copy.name + file.name.removeprefix(path.name)))
    return copy


def _check_tables(database: Any) -> None:
    for table in _TABLES:
        kinds = database.execute(_KINDS, (table,)).fetchall()
        hidden = database.execute("SELECT max(hidden) FROM pragma_table_xinfo(?)", (table,))
        if kinds != [("table", 1)] or hidden.fetchall() != [(0,)]:
            raise InputError(f"not a ROS bag: the database has no plain table {table}")
