"""What a registered table needs is read from the signature and the docstring of its function."""

from __future__ import annotations

from typing import TYPE_CHECKING

from puckbench.tables.registry import TableEntry, table_entries, table_entry

if TYPE_CHECKING:
    import pandas as pd


def ranks(
    metrics: pd.DataFrame,
    clouds: pd.DataFrame,
    scan_errors: pd.DataFrame | None = None,
    least: int = 4,
) -> pd.DataFrame:
    """Codecs in the order
    of their bits.

    Parameters
    ----------
    least
        Clouds.
    """
    return metrics.head(least)


def test_inputs_are_tables_and_those_with_a_default_may_lack() -> None:
    entry = TableEntry("ranks", ranks)
    assert entry.inputs == ("metrics", "clouds")
    assert entry.optional == ("scan_errors",)


def test_the_caption_ends_before_the_first_section() -> None:
    caption = TableEntry("ranks", ranks).caption
    assert " ".join(caption.split()) == "Codecs in the order of their bits."


def test_every_registered_table_is_found_by_its_name() -> None:
    entries = table_entries()
    assert {"machines", "against_octree", "noise_bits"} <= set(entries)
    assert all(table_entry(name) is entry for name, entry in entries.items())
    assert entries["against_octree"].inputs[0] == "metrics"
