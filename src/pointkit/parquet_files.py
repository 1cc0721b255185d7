"""Parquet files, checked before they are read."""

from __future__ import annotations

from pathlib import Path

from pointkit.errors import InputError
from pointkit.files import refuse_special
from pointkit.isolated import parser_limits

_VALUE_BYTES = 8


def check_parquet_memory(path: Path) -> None:
    """Raise InputError if a table would take more memory than `parser_limits` allows for its file.

    Files that are no Parquet raise nothing here: their reader says what they are.
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
    """Return the metadata of a Parquet file's schema; an empty dictionary for other files."""
    from pyarrow import ArrowException, parquet

    refuse_special(path)
    try:
        metadata: dict[bytes, bytes] = parquet.read_schema(path).metadata or {}
    except (OSError, UnicodeDecodeError, ArrowException):
        return {}
    return metadata
