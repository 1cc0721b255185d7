"""Comma-separated values as columns of numbers, read and written by Arrow."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.errors import InputError
from puckbench.core.files import read_bytes, written_whole


def read_csv(path: Path) -> dict[str, NDArray[Any]]:
    """Read the columns of numbers of a file whose first line has their names; in lower case."""
    import pyarrow as pa
    from pyarrow import csv

    read_bytes(path)
    try:
        table = csv.read_csv(path)
    except (pa.ArrowException, OSError) as error:
        fault = " ".join(str(error).split())
        raise InputError(f"{path}: not a readable CSV file ({fault})") from error
    columns = {str(name).strip().lower(): table.column(name) for name in table.column_names}
    return {
        name: column.to_numpy()
        for name, column in columns.items()
        if pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
    }


def write_csv(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns under a line of names, numbers as short as they come back the same."""
    import pyarrow as pa
    from pyarrow import csv

    table = pa.table({name: np.ascontiguousarray(part) for name, part in columns.items()})
    with written_whole(path) as temporary:
        csv.write_csv(table, temporary, csv.WriteOptions(quoting_style="none"))
