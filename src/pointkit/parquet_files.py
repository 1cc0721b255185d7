from __future__ import annotations

from pathlib import Path

from pointkit.errors import InputError
from pointkit.files import refuse_special
from pointkit.isolated import parser_limits

_VALUE_BYTES = 8


def check_parquet_memory(path: Path) -> None:
    """Raise InputError if the decoded table exceeds the memory limit of `parser_limits`."""
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
