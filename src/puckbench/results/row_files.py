"""Files of rows of results, which jobs write and tables join."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pointkit.column_tables import check_parquet_memory
from pointkit.errors import InputError
from pointkit.files import written_whole

CODE = ()


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows of results, given as values by column name, to a Parquet file."""
    import pyarrow as pa
    from pyarrow import parquet

    names = dict.fromkeys(name for row in rows for name in row)
    table = pa.table({name: [row.get(name) for row in rows] for name in names})
    with written_whole(path) as temporary:
        parquet.write_table(table, temporary, compression="zstd")


def read_rows(paths: Iterable[Path]) -> list[dict[str, Any]]:
    """Return the rows of results in Parquet files, as one list of values by column name.

    A row lacks the columns in which it has no value.
    """
    import pyarrow as pa
    from pyarrow import parquet

    rows: list[dict[str, Any]] = []
    for path in paths:
        check_parquet_memory(path)
        try:
            rows += parquet.ParquetFile(path).read().to_pylist()
        except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
            fault = " ".join(str(error).split())
            raise InputError(f"{path}: not a readable table of results ({fault})") from error
    return [{key: value for key, value in row.items() if value is not None} for row in rows]
