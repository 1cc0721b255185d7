"""Reference results: the result rows of a study in a Parquet file.

A row contains its cloud's digest. JSON in the schema's metadata describes how the results were
made.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import Field

from pointkit.errors import InputError, among, naming
from pointkit.files import json_of, written_whole
from pointkit.models import Model, parsed
from puckbench.metrics.tables.rate_deltas import MARGIN_PERCENT
from puckbench.report.column_labels import is_time, name_in_words
from puckbench.report.run_record import RunRecord

if TYPE_CHECKING:
    import pandas as pd

    from puckbench.figures.style import FigureStyle

FOLDER = Path(__file__).parent / "reference"
OF_DRIVES = Path(__file__).parent / "reference_drives"
"""Folder with tables of results on drives."""
DIGEST = "digest"
"""Column with the digest of a cloud's coordinates."""
KEY = "puckbench.reference"
FORMAT = 1
_TITLES = {
    "default": "The default run",
    "capod": "CAPOD",
    "capod_first": "CAPOD, the first object of each class",
    "real": "Real objects and rooms",
    "sweeps": "Turns of a sensor",
    "evidence": "Rooms, objects and streets with several seeds",
    "capod_learned": "CAPOD, learned codecs",
    "sweeps_reno": "Turns of a sensor, RENO",
}
_DIGITS = 6
"""Significant digits of measured numbers."""
_CLOUD = ["dataset", "cloud"]
_NUMBERS = ("diameter", "hausdorff_point", "peak")
_ENDINGS = ("_s", "_mse", "_psnr")
"""Columns, and ends of columns, whose numbers a comparison uses."""
_COLUMNS = (*_CLOUD, DIGEST, "codec", "rate", "bytes", "bpp")
"""Columns of every file."""
_TIMED = ("encode_curve", "evaluate_curve", "encode_drive")
"""Jobs that time codecs."""
MIN_PROCESSOR_SHARE = 0.95
"""Minimum ratio of processor to wall time of `_TIMED` jobs (one thread each) on an idle machine.
Measured: 0.97 (encoding) and 0.99 (decoding, evaluation) on an idle machine, 0.83 and 0.88 on a
busy one (docs/notes/times.md)."""


class _BdRate(Model, extra="ignore"):
    anchor: str
    qualities: tuple[str, ...]
    margin_percent: float = Field(MARGIN_PERCENT, ge=0)


class _About(Model, extra="ignore"):
    configuration: Mapping[str, Any]
    style: tuple[Mapping[str, Any], ...]
    bd_rate: _BdRate
    machine: Mapping[str, str]
    record: Mapping[str, Any]
    clouds: tuple[Mapping[str, Any], ...]
    scan_errors: tuple[Mapping[str, Any], ...] = ()
    not_timed: str = ""


@dataclass(frozen=True)
class ReferenceResults:
    """The results of a study.

    Parameters
    ----------
    metrics
        A row for each data set, cloud, codec and rate, with the `DIGEST` of the cloud.
    about
        ``configuration``, ``style``, ``bd_rate``, ``machine``, ``record``, rows of the tables
        ``clouds`` and ``scan_errors``, and ``not_timed``, the reason for missing times.
    """

    name: str
    metrics: pd.DataFrame
    about: Mapping[str, Any]

    @property
    def title(self) -> str:
        return _TITLES.get(self.name, name_in_words(self.name))

    @cached_property
    def style(self) -> FigureStyle:
        from puckbench.figures.style import FigureStyle

        return FigureStyle.from_config(*self.about["style"])

    @property
    def bd_rate(self) -> Mapping[str, Any]:
        """Options for the study's Bjontegaard deltas."""
        return parsed(_BdRate, self.about["bd_rate"], "bd_rate").model_dump()

    @property
    def record(self) -> RunRecord:
        return RunRecord.from_json(self.about["record"])

    @property
    def not_timed(self) -> str:
        return str(self.about.get("not_timed", ""))

    def table(self, name: str) -> pd.DataFrame | None:
        """Return the table ``clouds`` or ``scan_errors``; None if it has no rows."""
        import pandas as pd

        rows = self.about.get(name)
        return pd.DataFrame(rows) if rows else None

    @cached_property
    def clouds(self) -> dict[str, tuple[str, str]]:
        """Data set and name of each cloud, by digest."""
        distinct = self.metrics[[DIGEST, *_CLOUD]].drop_duplicates()
        return {str(d): (str(s), str(c)) for d, s, c in distinct.itertuples(index=False)}


def shipped_studies() -> list[str]:
    return sorted(path.stem for path in FOLDER.glob("*.parquet"))


def read_reference(name: str) -> ReferenceResults:
    """Read reference results: a study of puckbench, by name, or a ``.parquet`` file.

    An unknown study or invalid file raises InputError.
    """
    if name.endswith(".parquet"):
        return _read(Path(name))
    if name not in shipped_studies():
        suggestion = (
            among(name, shipped_studies()) if shipped_studies() else " (this version has none)"
        )
        raise InputError(f"no reference results '{name}'{suggestion}")
    return _read(FOLDER / f"{name}.parquet")


def _read(path: Path) -> ReferenceResults:
    from pointkit.column_tables import parquet_metadata
    from pointkit.tables import check_columns, read_table
    from puckbench.figures.style import FigureStyle

    table = read_table(path)
    with naming(path):
        about = json_of(parquet_metadata(path).get(KEY.encode(), b"{}"), "its metadata")
        if not isinstance(about, dict) or "format" not in about:
            raise InputError("not a file of reference results")
        if about["format"] != FORMAT:
            raise InputError(f"format {about['format']!r}, but this version reads {FORMAT}")
        if missing := [name for name in _COLUMNS if name not in table]:
            raise InputError(f"not reference results, without {', '.join(missing)}")
        check_results(table)
        check_columns(table, [DIGEST])
        parsed(_About, about, "its metadata")
        FigureStyle.from_config(*about["style"])
        RunRecord.from_json(about["record"])
    return ReferenceResults(path.stem, table, about)


def check_results(metrics: pd.DataFrame) -> None:
    """Raise InputError if a table of results lacks columns, or they are not text or numbers."""
    from pointkit.tables import check_columns

    used = [name for name in map(str, metrics) if name in _NUMBERS or name.endswith(_ENDINGS)]
    check_columns(metrics, (*_CLOUD, "codec", "rate"), ("bytes", "bpp", *used))


def write_reference(path: Path, metrics: pd.DataFrame, about: Mapping[str, Any]) -> None:
    """Write the results of a study, named after the file; `about` is as in `ReferenceResults`.

    Raises InputError if a cloud has no digest.
    """
    digests = {(row["dataset"], row["cloud"]): row.get(DIGEST) for row in about["clouds"]}
    keys = [(str(s), str(c)) for s, c in metrics[_CLOUD].itertuples(index=False)]
    missing = next((key for key in keys if not digests.get(key)), None)
    if missing:
        raise InputError(f"cloud {'/'.join(missing)}: the table of clouds has no digest of it")
    rows = _rounded(metrics)
    rows.insert(2, DIGEST, [digests[key] for key in keys])
    _write(path, rows, about)


def write_drive_results(path: Path, drives: pd.DataFrame, about: Mapping[str, Any]) -> None:
    _write(path, _rounded(drives), about)


def _write(path: Path, rows: pd.DataFrame, about: Mapping[str, Any]) -> None:
    import pyarrow as pa

    table = pa.Table.from_pandas(rows, preserve_index=False)
    text = json.dumps({"format": FORMAT, **about}, sort_keys=True, allow_nan=False)
    with written_whole(path) as temporary:
        _write_small(temporary, table, {**table.schema.metadata, KEY: text})


def _write_small(path: Path, table: Any, metadata: Mapping[Any, Any]) -> None:
    """Write an Arrow table to a small file with dictionary-encoded text and byte-split floats."""
    import pyarrow as pa
    from pyarrow import parquet

    words = [field.name for field in table.schema if pa.types.is_large_string(field.type)]
    words += [field.name for field in table.schema if pa.types.is_string(field.type)]
    numbers = [field.name for field in table.schema if pa.types.is_floating(field.type)]
    plain = table.replace_schema_metadata(None)
    with parquet.ParquetWriter(
        path,
        plain.schema,
        compression="zstd",
        compression_level=19,
        use_dictionary=words,
        column_encoding=dict.fromkeys(numbers, "BYTE_STREAM_SPLIT"),
        write_statistics=False,
        store_schema=False,
    ) as writer:
        writer.write_table(plain)
        writer.add_key_value_metadata(metadata)


def why_not_timed(costs: Iterable[Mapping[str, Any]]) -> str:
    """Return why a run's times are not comparable, judged by job costs; empty if comparable."""
    timed = [cost for cost in costs if cost["job"] in _TIMED]
    if not timed:
        return "no log tells whether the machine was idle"
    processor, wall = (sum(cost[name] for cost in timed) for name in ("processor_s", "wall_s"))
    if processor >= MIN_PROCESSOR_SHARE * wall:
        return ""
    return (
        f"the machine was busy: its coding jobs had a processor for {processor / wall:.0%} of "
        f"their time, of which {MIN_PROCESSOR_SHARE:.0%} are asked"
    )


def without_times(metrics: pd.DataFrame) -> pd.DataFrame:
    return metrics[[name for name in metrics if not is_time(str(name))]]


def _rounded(table: Any) -> pd.DataFrame:
    rounded: pd.DataFrame = table.copy()
    for column in table.select_dtypes("floating"):
        values = [float(f"{value:.{_DIGITS}g}") for value in table[column]]
        rounded[column] = values
        if column != "bpp":
            rounded[column] = rounded[column].astype("float32")
    return rounded


def plain_rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = json.loads(table.to_json(orient="records", double_precision=10))
    return [{key: value for key, value in row.items() if value is not None} for row in rows]
