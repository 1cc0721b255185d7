"""Tables of returns whose columns are declared as data: rows in memory, Parquet with units on disk.

A kind of table is a class with its declaration (`Declared`); the table of a virtual scan and that
of a recording are two of them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.files import json_of, written_whole
from puckbench.geometry.cloud import Floats
from puckbench.io.parquet_rows import check_rows

Columns = dict[str, tuple[str, str, str]]
"""Name: (type, unit, meaning), in the order in which they stand in a file."""


@dataclass(frozen=True)
class Declared:
    """What a kind of table is called, its columns, and its key in a file's metadata."""

    name: str
    key: str
    columns: Columns


@dataclass(frozen=True)
class Table:
    """Returns: arrays of equal length by the names declared, and how they were made."""

    declared: ClassVar[Declared]

    columns: dict[str, NDArray[Any]]
    about: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns["distance"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def xyz(self) -> Floats:
        """Points, m, (n, 3), in the frame that the columns x, y and z declare."""
        return self.vectors("x", "y", "z")

    def vectors(self, *names: str) -> Floats:
        """The named columns side by side, (n, number of names)."""
        return np.column_stack([self.columns[name] for name in names])

    def select(self, rows: NDArray[Any]) -> Self:
        """The given rows (mask, indices or slice)."""
        return replace(self, columns={name: part[rows] for name, part in self.columns.items()})


T = TypeVar("T", bound=Table)


def empty_columns(declared: Declared, rows: int) -> dict[str, NDArray[Any]]:
    """Columns with room for `rows` returns, their values undefined."""
    return {name: np.empty(rows, dtype=kind) for name, (kind, _, _) in declared.columns.items()}


def write_table(path: Path, table: Table) -> None:
    """Write a Parquet file; each column's metadata has its ``unit`` and ``description``.

    `about` stands as JSON in the schema's metadata under the key declared.
    """
    from pyarrow import parquet

    with written_whole(path) as temporary:
        parquet.write_table(_rows(table), temporary, **_encoding(table.declared))


def write_portions(path: Path, portions: Iterator[Table]) -> int:
    """Write a table that comes in portions, each its own row group; the number of its rows.

    One portion is in memory at a time; the first one's `about` is the file's. Raises ValueError
    for no portion; whatever `portions` raises leaves no file.
    """
    from pyarrow import parquet

    first = next(portions, None)
    if first is None:
        raise ValueError("a table without a portion")
    opening, count, encoding = _rows(first), len(first), _encoding(first.declared)
    with (
        written_whole(path) as temporary,
        parquet.ParquetWriter(temporary, opening.schema, **encoding) as writer,
    ):
        writer.write_table(opening, row_group_size=count)
        del first, opening
        for portion in portions:
            writer.write_table(_rows(portion, writer.schema), row_group_size=len(portion))
            count += len(portion)
    return count


def read_table(path: Path, kind: type[T]) -> T:
    """Read a table of the given kind; InputError when it is missing, damaged or lacks a column."""
    import pyarrow as pa
    from pyarrow import parquet

    declared = kind.declared
    check_rows(path)
    try:
        rows = parquet.read_table(path)
        names = rows.column_names
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        reason = "no such file" if not path.exists() else "not a readable Parquet file"
        raise InputError(f"{path}: {reason}") from error
    missing = [name for name in declared.columns if name not in names]
    if missing:
        raise InputError(f"{path}: not a {declared.name}, it lacks {', '.join(missing)}")
    text = (rows.schema.metadata or {}).get(declared.key.encode(), b"{}")
    about = json_of(text, f"{path}: its metadata")
    if not isinstance(about, dict):
        raise InputError(f"{path}: its metadata: not a JSON object")
    columns = {
        name: rows.column(name).to_numpy().astype(form, copy=False)
        for name, (form, _, _) in declared.columns.items()
    }
    return kind(columns, about)


def metadata_of(path: Path) -> dict[bytes, bytes]:
    """The metadata of a Parquet file, whose keys tell the kind of table; none for another file."""
    from pyarrow import ArrowException, parquet

    try:
        found: dict[bytes, bytes] = parquet.read_schema(path).metadata or {}
    except (OSError, UnicodeDecodeError, ArrowException):
        return {}
    return found


def _rows(table: Table, schema: Any = None) -> Any:
    """The table for Arrow, its `about` in the schema's metadata unless a schema is given."""
    import pyarrow as pa

    declared = table.declared
    if schema is None:
        about = json.dumps(table.about, sort_keys=True, allow_nan=False)
        fields = [_field(name, *column) for name, column in declared.columns.items()]
        schema = pa.schema(fields).with_metadata({declared.key: about})
    return pa.table([pa.array(table[name]) for name in declared.columns], schema=schema)


def _field(name: str, kind: str, unit: str, meaning: str) -> Any:
    import pyarrow as pa

    metadata = {"unit": unit, "description": meaning}
    return pa.field(name, pa.from_numpy_dtype(np.dtype(kind)), nullable=False, metadata=metadata)


def _encoding(declared: Declared) -> dict[str, Any]:
    floats = [name for name, (kind, _, _) in declared.columns.items() if kind == "<f8"]
    whole = [name for name in declared.columns if name not in floats]
    return {"compression": "zstd", "use_byte_stream_split": floats, "use_dictionary": whole}
