"""Published numbers as package data: every row tells its conditions, or is refused."""

from __future__ import annotations

import csv
import hashlib
import io
from pathlib import Path

import numpy as np
import pytest

import puckbench.published_sources as room
from pointkit.errors import InputError
from puckbench.published_sources.registry import SOURCES, all_sources, source_named
from puckbench.published_sources.rows import COLUMNS, rows_beside, rows_of_file

FOLDER = Path(room.__file__).parent
ROW = {
    "dataset": "KITTI", "cloud": "mean", "codec": "G-PCC octree", "codec_version": "TMC13 v21",
    "rate": "R3", "bpp": "11.2", "measure": "d1_psnr", "value": "82.14", "peak": "30 m",
    "points": "119952", "frames": "not stated", "resolution": "1 mm", "anchor": "none",
    "anchor_version": "none", "machine": "none", "place": "Table 2",
}  # fmt: skip
BD_RATE = {
    **ROW, "rate": "R0..R5 against R1..R5", "bpp": "none", "measure": "bd_rate_d1",
    "value": "-12.3", "peak": "none", "anchor": "Draco", "anchor_version": "1.5",
}  # fmt: skip


def written(path: Path, *rows: dict[str, str]) -> Path:
    text = io.StringIO()
    lines = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    lines.writeheader()
    lines.writerows(rows)
    path.write_text(text.getvalue(), encoding="utf-8")
    return path


def refused(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        rows_of_file(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("source", all_sources(), ids=lambda source: source.name)
def test_a_source_has_rows_a_title_and_a_licence(source: object) -> None:
    rows = source.rows
    assert len(rows) >= 16
    assert all((source.title, source.address, source.licence))
    assert not rows.drop(columns=["bpp", "points", "frames"]).isna().any(axis=None)
    keys = ["dataset", "cloud", "codec", "codec_version", "rate", "measure", "resolution", "anchor"]
    assert not rows.duplicated([*keys, "place"]).any()


def test_the_files_are_small_and_each_belongs_to_a_source() -> None:
    files = sorted(FOLDER.glob("*.csv"))
    assert {path.stem for path in files} <= set(SOURCES.names())
    assert sum(path.stat().st_size for path in files) < 700_000


def test_known_numbers_stand_where_they_were_printed() -> None:
    """KITTI at 1 mm without loss, and a rate of PCGCv2, as both repositories print them."""
    rows = source_named("unicorn").rows
    kitti = rows[(rows["dataset"] == "KITTI") & rows["place"].str.contains("lidar")]
    lossless = kitti[(kitti["measure"] == "d1_psnr") & np.isinf(kitti["value"])]
    bits = dict(zip(lossless["codec_version"], lossless["bpp"].round(2), strict=False))
    assert bits["TMC13 v21"] == 20.22
    assert bits["v1, static, as dynamic's"] == 16.68
    assert bits["v1, dynamic"] == 15.94
    assert set(lossless["peak"]) == {"30 m"}
    rows = source_named("pcgcv2").rows
    dress = rows[(rows["cloud"] == "longdress_vox10_1300") & (rows["rate"] == "R2")]
    values = dict(zip(dress["measure"], dress["value"], strict=True))
    assert (values["d1_psnr"], values["d2_psnr"]) == (69.9246, 72.9562)
    assert set(dress["bpp"]) == {0.093}


def test_rows_of_a_user_are_read(tmp_path: Path) -> None:
    table = rows_of_file(written(tmp_path / "mine.csv", ROW, BD_RATE))
    assert table["value"].tolist() == [82.14, -12.3]
    assert table["frames"].isna().all()
    source = source_named(str(tmp_path / "mine.csv"))
    assert (source.title, len(source.rows)) == ("mine", 2)


@pytest.mark.parametrize(
    ("column", "text", "message"),
    [
        ("peak", "", "line 3: no peak (write 'not stated' if the source does not say it)"),
        ("machine", " ", "line 3: no machine"),
        ("peak", "none", "line 3: d1_psnr with the peak 'none'"),
        ("peak", "30 km", "line 3: peak '30 km' is not a number"),
        ("measure", "d1_pnsr", "did you mean 'd1_psnr'?"),
        ("measure", "encode_s", "line 3: encode_s with the peak '30 m'"),
        ("points", "many", "line 3: points 'many' is not a number above 0"),
        ("bpp", "-1", "line 3: bpp '-1' is not a number above 0"),
        ("value", "nan", "line 3: value 'nan' is not a number"),
        ("anchor", "Draco", "line 3: d1_psnr with the anchor 'Draco'"),
    ],
)
def test_a_row_without_a_condition_is_refused(
    column: str, text: str, message: str, tmp_path: Path
) -> None:
    path = written(tmp_path / "mine.csv", ROW, {**ROW, column: text})
    found = refused(path)
    assert found.startswith(f"{path}: ")
    assert message in found


@pytest.mark.parametrize(
    ("column", "text", "message"),
    [
        ("anchor", "none", "bd_rate_d1 with the anchor 'none'"),
        ("rate", "R0..R5", "rate 'R0..R5' is not like 'R0..R5 against R1..R5'"),
    ],
)
def test_a_bd_rate_names_its_anchor_and_rates(
    column: str, text: str, message: str, tmp_path: Path
) -> None:
    assert message in refused(written(tmp_path / "mine.csv", {**BD_RATE, column: text}))


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "mine.csv", ROW, ROW)
    whole = path.read_bytes()
    for damaged, message in (
        (whole[:-40], "line 3 has 1"),
        (whole.replace(b"peak", b"top"), "the first line is not dataset,cloud,"),
        (whole[: whole.index(b"\n") + 1], "the table has no rows"),
        (b"", "the first line is not"),
        (whole.replace(b"Table 2", b'"Table 2'), "not a readable table of published numbers"),
        (whole.replace(b"Table", b"\xff\xfe"), "not a readable table of published numbers"),
    ):
        path.write_bytes(damaged)
        assert message in refused(path)
    assert "no such file" in refused(tmp_path / "none.csv")


def test_a_source_s_own_file_is_known_by_its_digest(tmp_path: Path) -> None:
    path = written(tmp_path / "source.csv", ROW)
    module = str(tmp_path / "source.py")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert len(rows_beside(module, digest)) == 1
    path.write_bytes(path.read_bytes().replace(b"82.14", b"92.14"))
    with pytest.raises(InputError, match=r"^source\.csv has the SHA-256 .* not the expected"):
        rows_beside(module, digest)


def test_an_unknown_source_is_named() -> None:
    with pytest.raises(InputError, match=r"no published source 'unicorns'.*did you mean 'unicorn'"):
        source_named("unicorns")
