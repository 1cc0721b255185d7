"""What the rows of a Parquet file take in memory, before they are read."""

from __future__ import annotations

from pathlib import Path

from puckbench.core.errors import InputError
from puckbench.io.isolated import limits

_VALUE_BYTES = 8


def check_rows(path: Path) -> None:
    """Refuse a file whose values take more memory than the file's size allows.

    Equal values take hardly any room in a file. What is no Parquet file is left to its reader.

    Raises
    ------
    InputError
        Its rows are too many, see `puckbench.io.isolated.limits`.
    """
    from pyarrow import ArrowException, parquet

    try:
        metadata = parquet.read_metadata(path)
    except (OSError, UnicodeDecodeError, ArrowException):
        return
    most, _ = limits(path.stat().st_size)
    if metadata.num_rows * metadata.num_columns * _VALUE_BYTES > most:
        raise InputError(
            f"{path}: {metadata.num_rows} rows of {metadata.num_columns} columns take more than "
            f"{most / 2**30:.3g} GiB, too much for a file of its size"
        )
