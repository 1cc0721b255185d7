from __future__ import annotations

from pathlib import Path

import pandas as pd

from puckbench.core.errors import InputError, naming
from puckbench.core.files import refuse_special, unreadable, written_whole
from puckbench.io.damage import reading
from puckbench.io.parquet_files import check_parquet_memory

_TEXT_COLUMNS = ("dataset", "cloud", "scene", "group", "codec", "rate")
_DAMAGE = (ValueError, NotImplementedError, LookupError, TypeError, AttributeError)


def read_table(path: Path) -> pd.DataFrame:
    """Read a CSV or Parquet file; raise InputError if it has no rows."""
    try:
        with naming(path), reading("table", *_DAMAGE):
            table = _read(path)
    except OSError as error:
        raise unreadable(path, error) from error
    if len(table) == 0:
        raise InputError(f"{path}: the table has no rows")
    return table


def write_table(table: pd.DataFrame, *paths: Path) -> None:
    for path in paths:
        with written_whole(path) as temporary:
            if path.suffix == ".parquet":
                table.to_parquet(temporary, compression="zstd", index=False)
            else:
                table.to_csv(temporary, index=False)


def _read(path: Path) -> pd.DataFrame:
    if path.suffix == ".parquet":
        check_parquet_memory(path)
        return pd.read_parquet(path)
    refuse_special(path)
    return pd.read_csv(path, dtype=dict.fromkeys(_TEXT_COLUMNS, "str"))
