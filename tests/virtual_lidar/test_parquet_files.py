"""Parquet files of few bytes and many rows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from pointkit.errors import InputError
from pointkit.lidar.return_table import read_return_table
from pointkit.tables import read_table
from virtual_lidar.residual_table import read_residuals

ROWS, COLUMNS, PORTIONS = 5_000_000, 8, 8


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """More than 2 GiB of zeros in few bytes."""
    place = tmp_path_factory.mktemp("rows") / "a.parquet"
    zeros = pa.array(np.zeros(ROWS, np.int64))
    portion = pa.table({f"c{column}": zeros for column in range(COLUMNS)})
    with parquet.ParquetWriter(place, portion.schema, compression="zstd") as writer:
        for _ in range(PORTIONS):
            writer.write_table(portion, row_group_size=ROWS)
    assert place.stat().st_size < 2**22
    return place


@pytest.mark.parametrize("read", [read_table, read_return_table, read_residuals])
def test_a_small_file_of_many_rows_is_refused(read: Callable[[Path], Any], path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.parquet: 40000000 rows of 8 columns take more than"):
        read(path)
