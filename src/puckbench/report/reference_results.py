"""Reference results: the results of a study, stored in a Parquet file.

A row of the file contains the digest of its cloud. JSON in the metadata of the file describes how
the results were made.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from pydantic import Field

from pointkit.errors import InputError, among, naming
from pointkit.files import json_of, written_whole
from pointkit.models import Model, parsed
from puckbench.core.archives import SUFFIX
from puckbench.core.renamed_keys import with_new_keys
from puckbench.report.run_record import RunRecord
from puckbench.results.bundles import REFERENCE, read_bundle
from puckbench.results.columns import column_named, name_in_words
from puckbench.tables.rate_deltas import MARGIN_PERCENT

if TYPE_CHECKING:
    import pandas as pd

    from puckbench.figures.style import FigureStyle

FOLDER = Path(__file__).parent / "reference"
OF_DRIVES = Path(__file__).parent / "reference_drives"
"""Folder with tables of results on drives, i.e. consecutive turns of a moving sensor."""
DIGEST = "digest"
"""Name of the column with the digest of a cloud's coordinates."""
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
    "perception": "Perception after decoding",
}
_DIGITS = 6
"""Number of significant digits of measured values."""
_CLOUD = ["dataset", "cloud"]
_NUMBERS = ("diameter", "hausdorff_point", "peak")
_ENDINGS = ("_s", "_mse", "_psnr")
"""Columns, and endings of columns, whose numbers a comparison uses."""
_COLUMNS = (*_CLOUD, DIGEST, "codec", "rate", "bytes", "bpp")
"""Columns that every file has."""
_TIMED = ("encode", "evaluate", "encode_drive")
"""Names of the jobs that time codecs."""
MIN_PROCESSOR_SHARE = 0.95
"""Smallest ratio of processor time to wall time of `_TIMED` jobs (one thread each) on an idle
machine.

Measured: 0.97 (encoding) and 0.99 (decoding, evaluation) on an idle machine, 0.83 and 0.88 on a
busy one (docs/notes/times.md).
"""


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
    """The results of a study, with which runs are compared.

    Parameters
    ----------
    name
        Name of the study.
    metrics
        A row for each data set, cloud, codec and rate, with the `DIGEST` of the cloud.
    about
        Description of the study: ``configuration``, ``style``, ``bd_rate``, ``machine``,
        ``record``, rows of the tables ``clouds`` and ``scan_errors``, and ``not_timed``, the reason
        for missing times.
    """

    name: str
    metrics: pd.DataFrame
    about: Mapping[str, Any]

    @property
    def title(self) -> str:
        """Title of the study."""
        return _TITLES.get(self.name, name_in_words(self.name))

    @cached_property
    def style(self) -> FigureStyle:
        """Style of the study's figures."""
        from puckbench.figures.style import FigureStyle

        return FigureStyle.from_config(*self.about["style"])

    @property
    def bd_rate(self) -> Mapping[str, Any]:
        """Options with which the study's BD-rates are computed: anchor, qualities and margin."""
        return parsed(_BdRate, self.about["bd_rate"], "bd_rate").model_dump()

    @property
    def record(self) -> RunRecord:
        """Date, duration and commits of the study's run."""
        return RunRecord.from_json(self.about["record"])

    @property
    def not_timed(self) -> str:
        """Reason why the study has no times, or empty."""
        return str(self.about.get("not_timed", ""))

    def table(self, name: str) -> pd.DataFrame | None:
        """Return the study's table ``clouds`` or ``scan_errors``, or None if it has no rows."""
        import pandas as pd

        rows = self.about.get(name)
        return pd.DataFrame(rows) if rows else None

    @cached_property
    def clouds(self) -> dict[str, tuple[str, str]]:
        """Names of the data set and of the cloud, by the cloud's digest."""
        distinct = self.metrics[[DIGEST, *_CLOUD]].drop_duplicates()
        return {str(d): (str(s), str(c)) for d, s, c in distinct.itertuples(index=False)}


def shipped_studies() -> list[str]:
    """Return the names of the studies that come with puckbench."""
    return sorted(path.stem for path in FOLDER.glob("*.parquet"))


def read_reference(name: str) -> ReferenceResults:
    """Read reference results.

    Parameters
    ----------
    name
        Name of a study that comes with puckbench, or path of a ``.parquet`` file or of a bundle
        (``.zip``).

    Raises
    ------
    InputError
        The study is unknown, or the file is not valid.
    """
    if name.endswith(".parquet"):
        return _read(Path(name))
    if name.endswith(SUFFIX):
        return _of_bundle(Path(name))
    if name not in shipped_studies():
        suggestion = (
            among(name, shipped_studies()) if shipped_studies() else " (this version has none)"
        )
        raise InputError(f"no reference results '{name}'{suggestion}")
    return _read(FOLDER / f"{name}.parquet")


def _of_bundle(path: Path) -> ReferenceResults:
    bundle = read_bundle(path)
    if REFERENCE not in bundle.members:
        raise InputError(f"{path}: a bundle without results of codecs on clouds")
    with TemporaryDirectory() as folder, naming(path):
        file = Path(folder, path.with_suffix(".parquet").name)
        file.write_bytes(bundle.members[REFERENCE])
        return _read(file)


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
        about["configuration"] = with_new_keys(about["configuration"])
        FigureStyle.from_config(*about["style"])
        RunRecord.from_json(about["record"])
    return ReferenceResults(path.stem, table, about)


def check_results(metrics: pd.DataFrame) -> None:
    """Raise InputError if a table of results lacks columns, or has columns of the wrong type."""
    from pointkit.tables import check_columns

    used = [name for name in map(str, metrics) if name in _NUMBERS or name.endswith(_ENDINGS)]
    check_columns(metrics, (*_CLOUD, "codec", "rate"), ("bytes", "bpp", *used))


def write_reference(path: Path, metrics: pd.DataFrame, about: Mapping[str, Any]) -> None:
    """Write the results of a study to a file, whose name is that of the study.

    Parameters
    ----------
    path
        Parquet file to write.
    metrics
        Results of the study.
    about
        Description of the study, as in `ReferenceResults`.

    Raises
    ------
    InputError
        A cloud has no digest.
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
    """Write results on drives to a Parquet file; `about` is as in `ReferenceResults`."""
    _write(path, _rounded(drives), about)


def _write(path: Path, rows: pd.DataFrame, about: Mapping[str, Any]) -> None:
    import pyarrow as pa

    table = pa.Table.from_pandas(rows, preserve_index=False)
    text = json.dumps({"format": FORMAT, **about}, sort_keys=True, allow_nan=False)
    with written_whole(path) as temporary:
        _write_small(temporary, table, {**table.schema.metadata, KEY: text})


def _write_small(path: Path, table: Any, metadata: Mapping[Any, Any]) -> None:
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
    """Return why the times of a run cannot be compared with other times.

    Parameters
    ----------
    costs
        Processor time and wall time of the run's jobs.

    Returns
    -------
    str
        The reason, such as that the machine was busy, or an empty text if times are comparable.
    """
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
    """Return a table of results without the columns of times."""
    return metrics[[name for name in metrics if not column_named(str(name)).timed]]


def _rounded(table: Any) -> pd.DataFrame:
    rounded: pd.DataFrame = table.copy()
    for name in table.select_dtypes("floating"):
        values = [float(f"{value:.{_DIGITS}g}") for value in table[name]]
        rounded[name] = values
        if name != "bpp":
            rounded[name] = rounded[name].astype("float32")
    return rounded


def plain_rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of a table as JSON objects without missing values."""
    rows: list[dict[str, Any]] = json.loads(table.to_json(orient="records", double_precision=10))
    return [{key: value for key, value in row.items() if value is not None} for row in rows]
