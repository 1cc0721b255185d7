"""Tables of named columns with units, such as returns of a LiDAR, and their Parquet files.

A subclass of `ColumnTable` declares its columns in a `TableSchema`. Examples are `ReturnTable` (one
row for each return), `FiringTable` (one row for each firing of a laser), and the table of a virtual
scan.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from pointkit.errors import InputError
from pointkit.files import object_of, refuse_special, written_whole
from pointkit.geometry.cloud import Floats
from pointkit.isolated import parser_limits

_VALUE_BYTES = 8

ColumnSpecs = dict[str, tuple[str, str, str]]
"""(NumPy type, unit, description) of each column, in the order of the file."""


@dataclass(frozen=True)
class TableSchema:
    """What all tables of one kind, and their files, have in common.

    Parameters
    ----------
    name
        Noun for the table in error messages.
    metadata_key
        Key under which a Parquet file of this kind stores the table's description as JSON. The key
        also identifies the kind of table.
    columns
        Type, unit and description of each column.
    optional
        The same of columns that only some tables of the kind have.
    """

    name: str
    metadata_key: str
    columns: ColumnSpecs
    optional: ColumnSpecs = field(default_factory=dict)

    def of(self, names: Collection[str]) -> ColumnSpecs:
        """Return the specifications of all columns of a table that has columns `names`."""
        found = {name: spec for name, spec in self.optional.items() if name in names}
        return {**self.columns, **found}


@dataclass(frozen=True)
class ColumnTable:
    """Base class of tables of named columns of n rows, with a description.

    ``table["distance"]`` returns a column, and ``len(table)`` the number of rows. Each subclass has
    a `schema`, and its columns include one named ``distance``.

    Parameters
    ----------
    columns
        Arrays (n,) by name.
    about
        Description of the table, whose values JSON can represent.
    """

    schema: ClassVar[TableSchema]

    columns: dict[str, NDArray[Any]]
    about: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns["distance"])

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def xyz(self) -> Floats:
        """Points (n, 3), m, from the columns x, y and z."""
        return self.vectors("x", "y", "z")

    def vectors(self, *names: str) -> Floats:
        """Return the named columns as one array (n, number of names)."""
        return np.column_stack([self.columns[name] for name in names])

    def select(self, rows: NDArray[Any]) -> Self:
        """Return a table of the rows that a mask (n,) or indices select."""
        return replace(self, columns={name: part[rows] for name, part in self.columns.items()})


T = TypeVar("T", bound=ColumnTable)


def write_column_table(path: Path, table: ColumnTable) -> None:
    """Write a table as a Parquet file, with the unit and description of each column."""
    from pyarrow import parquet

    with written_whole(path) as temporary:
        rows = _arrow_table(table)
        parquet.write_table(rows, temporary, **_encoding(table.schema.of(table.columns)))


def write_portions(path: Path, portions: Iterator[ColumnTable]) -> int:
    """Write several tables of one kind to one Parquet file, and return the file's number of rows.

    Only one table is in memory at a time: each one is written as a row group before the next is
    taken.

    Parameters
    ----------
    path
        The Parquet file.
    portions
        The tables, in the order of the file. The file gets the description of the first one.
    """
    from pyarrow import parquet

    first = next(portions, None)
    if first is None:
        raise ValueError("a table without a portion")
    rows, count = _arrow_table(first), len(first)
    encoding = _encoding(first.schema.of(first.columns))
    with (
        written_whole(path) as temporary,
        parquet.ParquetWriter(temporary, rows.schema, **encoding) as writer,
    ):
        writer.write_table(rows, row_group_size=count)
        del first, rows  # frees the memory
        for portion in portions:
            writer.write_table(_arrow_table(portion, writer.schema), row_group_size=len(portion))
            count += len(portion)
    return count


def read_column_table(path: Path, kind: type[T]) -> T:
    """Read a Parquet file as a table of the given class.

    Parameters
    ----------
    path
        The file.
    kind
        Class of the result, such as `ReturnTable`.

    Raises
    ------
    InputError
        The file is missing, not a Parquet file, or too large after decoding; or it lacks a column
        of `kind`, or values do not fit the type of their column.
    """
    import pyarrow as pa
    from pyarrow import parquet

    schema = kind.schema
    check_parquet_memory(path)
    try:
        rows = parquet.read_table(path)
        names = rows.column_names
    except (OSError, UnicodeDecodeError, pa.ArrowException) as error:
        reason = f"not a {schema.name} (Parquet)" if path.exists() else "no such file"
        raise InputError(f"{path}: {reason}") from error
    missing = [name for name in schema.columns if name not in names]
    if missing:
        raise InputError(f"{path}: not a {schema.name}, it lacks {', '.join(missing)}")
    text = (rows.schema.metadata or {}).get(schema.metadata_key.encode(), b"{}")
    about = object_of(text, f"{path}: its metadata")
    columns = {}
    for name, (form, _, _) in schema.of(names).items():
        values = rows.column(name).to_numpy()
        columns[name] = _exactly(f"{path}: column {name}", values, np.dtype(form))
    return kind(columns, about)


def check_parquet_memory(path: Path) -> None:
    """Raise InputError if a Parquet file's decoded columns exceed the limit of `parser_limits`.

    Files of other formats, and missing ones, are accepted: their reader refuses them.
    """
    from pyarrow import ArrowException, parquet

    refuse_special(path)
    try:
        metadata = parquet.read_metadata(path)
    except (OSError, UnicodeDecodeError, ArrowException):
        return
    limit, _ = parser_limits(path.stat().st_size)
    if metadata.num_rows * metadata.num_columns * _VALUE_BYTES > limit:
        table = f"{metadata.num_rows} rows of {metadata.num_columns} columns"
        fault = f"take more than {limit / 2**30:.3g} GiB, too much for a file of its size"
        raise InputError(f"{path}: {table} {fault}")


def parquet_metadata(path: Path) -> dict[bytes, bytes]:
    """Return a Parquet file's schema metadata, or an empty dictionary for other formats."""
    from pyarrow import ArrowException, parquet

    refuse_special(path)
    try:
        metadata: dict[bytes, bytes] = parquet.read_schema(path).metadata or {}
    except (OSError, UnicodeDecodeError, ArrowException):
        return {}
    return metadata


def _exactly(what: str, values: NDArray[Any], form: np.dtype[Any]) -> NDArray[Any]:
    if values.dtype.kind not in "fiu":
        raise InputError(f"{what} holds no numbers ({values.dtype})")
    with np.errstate(invalid="ignore"):
        converted = values.astype(form, copy=False)
    changed = converted != values
    if form.kind == "i" and changed.any():
        value, bits = values[np.argmax(changed)], 8 * form.itemsize
        raise InputError(f"{what} has {value}, where integers of {bits} bits are expected")
    return converted


def is_table_of(path: Path, kind: type[ColumnTable]) -> bool:
    """Return whether a file's metadata say that it is a Parquet file of a table of this kind."""
    return kind.schema.metadata_key.encode() in parquet_metadata(path)


def _arrow_table(table: ColumnTable, schema: Any = None) -> Any:
    import pyarrow as pa

    if schema is None:
        about = json.dumps(table.about, sort_keys=True, allow_nan=False)
        specs = table.schema.of(table.columns)
        fields = [_arrow_field(name, *spec) for name, spec in specs.items()]
        schema = pa.schema(fields).with_metadata({table.schema.metadata_key: about})
    return pa.table([pa.array(table[name]) for name in schema.names], schema=schema)


def _arrow_field(name: str, kind: str, unit: str, description: str) -> Any:
    import pyarrow as pa

    metadata = {"unit": unit, "description": description}
    return pa.field(name, pa.from_numpy_dtype(np.dtype(kind)), nullable=False, metadata=metadata)


def _encoding(specs: ColumnSpecs) -> dict[str, Any]:
    doubles = [name for name, (kind, _, _) in specs.items() if kind == "<f8"]
    others = [name for name in specs if name not in doubles]
    return {"compression": "zstd", "use_byte_stream_split": doubles, "use_dictionary": others}
