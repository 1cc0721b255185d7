"""Comma-separated values as columns of numbers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from puckbench.core.files import written_whole
from puckbench.io.cloud_text import read_text
from puckbench.io.point_columns import Columns


def read_csv(path: Path) -> Columns:
    """Read the columns of numbers of a text (see `read_text`); their names in lower case."""
    return {name.lower(): values for name, values in read_text(path).items()}


def write_csv(path: Path, columns: Mapping[str, NDArray[Any]]) -> None:
    """Write columns under a line of names, numbers as short as they come back the same."""
    import pyarrow as pa
    from pyarrow import csv

    table = pa.table({name: np.ascontiguousarray(part) for name, part in columns.items()})
    with written_whole(path) as temporary:
        csv.write_csv(table, temporary, csv.WriteOptions(quoting_style="none"))
