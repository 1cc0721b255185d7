"""Which columns of tables nobody has described."""

from __future__ import annotations

from collections.abc import Iterable

import pandas as pd

from puckbench.results.columns import column_named, declared_columns


def undeclared(tables: Iterable[pd.DataFrame]) -> set[str]:
    """Return the columns that neither are declared nor contain a statistic of a declared one."""
    declared = declared_columns()
    words = {each.words for each in declared.values()}
    names = {(str(name), tuple(table)) for table in tables for name in table}
    return {
        name
        for name, others in names
        if name not in declared
        and column_named(name, others).words.rpartition(", ")[0] not in words
    }
