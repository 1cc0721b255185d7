"""JSON of the wrong shape or type beside data is refused in one line that names it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from pyarrow import parquet

from cloud_files.clouds import read_cloud, write_cloud
from cloud_files.meshes import write_mesh
from pointkit.errors import InputError
from pointkit.files import read_json, read_object, write_json
from pointkit.geometry.cloud import PointCloud
from pointkit.tables import read_table, write_table
from puckbench.cli import main
from puckbench.report.reference_results import KEY, read_reference
from puckbench.steps.cost import read_cost
from puckbench.steps.process import main as job
from tests.support.reference_lookalike import rows_of, write_study
from tests.support.sensor_scenes import room


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    points = np.random.default_rng(0).random((300, 3)) * 1023
    write_cloud(Path("cloud.ply"), PointCloud(points, about={"size": 1024}))
    return tmp_path


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("[" * 200 + "]" * 200, "a.json: JSON nested more than 100 levels deep"),
        ('{"a": ' * 100_000, "a.json: JSON nested more than 100 levels deep"),
        ("9" * 5000, "a.json: not valid JSON"),
        ("\xff", "a.json: not valid JSON"),
        ("[1]", "a.json: not a JSON object"),
        ("null", "a.json: not a JSON object"),
    ],
)
def test_a_json_file_is_an_object_of_few_levels(text: str, fault: str) -> None:
    Path("a.json").write_text(text, encoding="latin-1")
    with pytest.raises(InputError) as refusal:
        read_object(Path("a.json"))
    assert str(refusal.value).startswith(fault)
    assert "\n" not in str(refusal.value)


def test_a_hundred_levels_are_read() -> None:
    Path("a.json").write_text("[" * 100 + "]" * 100)
    assert json.dumps(read_json(Path("a.json"))) == "[" * 100 + "]" * 100


@pytest.mark.parametrize(
    ("about", "fault"),
    [
        ({"scale": "x"}, "scale is 'x', but must be a valid number"),
        ({"scale": 0}, "scale is 0, but must be greater than 0"),
        ({"scale": float("inf")}, "scale is inf, but must be a finite number"),
        ({"offset": [1, 2]}, "offset.2: "),
        ({"offset": [1, 2, "3"]}, "offset.2 is '3', but must be a valid number"),
        ({"size": "1024"}, "size is '1024', but must be a valid integer"),
        ({"size": 10**400}, "size is 1000"),
        ({"size": -1}, "size is -1, but must be greater than or equal to 0"),
        ({"peak": [30]}, "peak is (30,), but must be a valid number"),
        ({"diameter": "far"}, "diameter is 'far'"),
        ({"name": {"a": 1}}, "name is {'a': 1}, but must be a valid string"),
        ({"grid": {"metres": 0, "origin": [0, 0, 0], "size": 8}}, "grid.metres is 0"),
    ],
)
def test_a_description_of_wrong_types_is_refused(about: dict[str, Any], fault: str) -> None:
    Path("cloud.json").write_text(json.dumps({"puckbench": "cloud", **about}))
    with pytest.raises(InputError, match=r"^cloud\.json: the cloud's description: ") as refusal:
        read_cloud(Path("cloud.ply"))
    assert "\n" not in str(refusal.value)
    if not fault.startswith("offset.2: "):
        assert fault in str(refusal.value)


def test_a_cloud_may_have_no_description_and_further_entries() -> None:
    about = {"size": 0, "scale": 1, "offset": [1, 2, 3], "peak": None, "credit": {"of": ["a"]}}
    Path("cloud.json").write_text(json.dumps({"puckbench": "cloud", **about}))
    assert read_cloud(Path("cloud.ply")).about == about


def _stream(record: object) -> list[str]:
    main(["encode", "cloud.ply", "a.bin", "--codec", "draco", "--rate", "r1"])
    Path("a.bin.json").write_text(json.dumps(record))
    return ["evaluate", "cloud.ply", "a.bin"]


def _box(about: object) -> list[str]:
    Path("box.json").write_text(json.dumps(about))
    return ["prepare", "cloud.ply", "out.ply", "--crop", "box.json"]


def _names(about: object) -> list[str]:
    Path("about.json").write_text(json.dumps(about))
    return ["prepare", "cloud.ply", "out.ply", "--about", "about.json"]


def _origin(about: object) -> list[str]:
    write_mesh(Path("room.ply"), replace(room(), labels=None))
    Path("room.json").write_text(json.dumps(about))
    return ["scan", "room.ply", "out.parquet"]


def _contents(contents: object) -> list[str]:
    return ["report", "out.html", "--contents", json.dumps(contents)]


def _entry(entry: object) -> list[str]:
    return ["train", "cloud.ply", "--out", "w.safetensors", "--entry", json.dumps(entry)]


@pytest.mark.parametrize(
    ("words", "value", "fault"),
    [
        (_stream, [1], "a.bin.json: not a JSON object"),
        (_stream, {"encode_s": "x"}, "a.bin.json: encode_s is 'x', but must be a valid number"),
        (_stream, {"codec": {"a": 1}}, "a.bin.json: codec is {'a': 1}, but must be a valid string"),
        (_box, [1], "box.json: not a JSON object"),
        (_box, {"box": "x"}, "box.json: box is 'x'"),
        (_box, {"box": [[1, 2, 3], [4, 5]]}, "box.json: "),
        (_names, [["name"]], "about.json: not a JSON object"),
        (_names, {"name": [1]}, "the cloud's description: name is"),
        (_origin, {"puckbench": "mesh", "origin": [1, 2]}, "room.json: "),
        (
            _origin,
            {"puckbench": "mesh", "origin": {"x": 1}},
            "room.json: origin is {'x': 1}",
        ),
        (_contents, {"metrics": 3}, "contents of the report: metrics is 3"),
        (_contents, {"figures": ["a"]}, "contents of the report: figures"),
        (_contents, {"configuration": {"datasets": {"a": 1}, "scenes": 3}}, "configuration"),
        (_contents, {"configuration": {"datasets": [1]}}, "configuration"),
        (_entry, {"class": 5}, "--entry: class is 5"),
    ],
)
def test_a_command_refuses_it_in_one_line(
    words: Any, value: object, fault: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = words(value)
    capsys.readouterr()
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert fault in said
    assert said.count("\n") == 1


def _reference(about: Mapping[str, Any] | str, **columns: Any) -> None:
    """The reference results of a test, with other metadata."""
    write_study(Path("study.parquet"))
    table = parquet.read_table("study.parquet")
    kept = json.loads(table.schema.metadata[KEY.encode()])
    text = about if isinstance(about, str) else json.dumps({**kept, **about})
    parquet.write_table(table.replace_schema_metadata({KEY: text}), "study.parquet")


@pytest.mark.parametrize(
    ("about", "fault"),
    [
        ("[" * 5000, "its metadata: JSON nested more than 100 levels deep"),
        ("{", "its metadata: not valid JSON"),
        ("[]", "not a file of reference results"),
        ({"format": "2"}, "format '2', but this version reads 1"),
        ({"configuration": 3}, "its metadata: configuration is 3"),
        ({"style": [[1]]}, "its metadata: style.0 is"),
        ({"style": [{"dpi": "x"}]}, "figure style: dpi is 'x'"),
        (
            {"bd_rate": {"anchor": "draco"}},
            "its metadata: the option 'bd_rate.qualities' is missing",
        ),
        ({"bd_rate": {"anchor": 1, "qualities": ["d1_psnr"]}}, "bd_rate.anchor is 1"),
        (
            {"bd_rate": {"anchor": "draco", "qualities": ["d1_psnr"], "margin_percent": -1}},
            "bd_rate.margin_percent is -1",
        ),
        ({"machine": {"a": 1}}, "machine.a is 1"),
        ({"record": {"jobs": "x"}}, "record: "),
        ({"clouds": {"a": 1}}, "clouds is {'a': 1}"),
    ],
)
def test_reference_results_of_wrong_types_are_refused(
    about: Mapping[str, Any] | str, fault: str
) -> None:
    _reference(about)
    with pytest.raises(InputError) as refusal:
        read_reference("study.parquet")
    assert str(refusal.value).startswith("study.parquet: ")
    assert fault in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "configuration", [{"datasets": 3}, {"scenes": []}, {"figures": 1}, {"bd_rate": {"anchor": []}}]
)
def test_a_study_s_configuration_of_wrong_types_is_refused(
    configuration: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    _reference({"configuration": configuration})
    assert main(["run", "--study", "study.parquet", "--codecs", "draco"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("puckbench: study: the configuration of the study: ")
    assert said.count("\n") == 1


@pytest.mark.parametrize("metadata", ["{}", '{"columns": 3}', "[", '{"index_columns": [{}]}'])
def test_wrong_metadata_of_pandas_are_refused_or_left_out(metadata: str) -> None:
    table = pa.table({"codec": ["draco"]}).replace_schema_metadata({"pandas": metadata})
    parquet.write_table(table, "a.parquet")
    with suppress(InputError):
        assert read_table(Path("a.parquet"))["codec"].tolist() == ["draco"]


@pytest.mark.parametrize("text", ["[]", "{", '{"sensor": 3}', '{"origin": [1]}'])
def test_a_scan_table_with_wrong_metadata_is_refused(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    write_mesh(Path("room.ply"), replace(room(), labels=None))
    sweep = ["--sweep", '{"preset": "spin", "azimuth_step_deg": 4}', "--origin", "2", "2", "1"]
    assert main(["scan", "room.ply", "scan.parquet", *sweep]) == 0
    table = parquet.read_table("scan.parquet")
    parquet.write_table(table.replace_schema_metadata({"puckbench": text}), "scan.parquet")
    capsys.readouterr()
    assert main(["prepare", "scan.parquet", "out.ply", "--turns", "0"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("puckbench: scan.parquet: ")
    assert said.count("\n") == 1


def test_a_row_that_is_no_object_and_a_description_without_a_key_are_named(
    capsys: pytest.CaptureFixture[str],
) -> None:
    files = ["results=.", "csv=a.csv", "parquet=a.parquet", "columns=columns.csv"]
    write_json(Path("r1.json"), [1])
    settings = json.dumps({"table": "scan_errors", "names": ["r1.json"]})
    assert job(["results_table", settings, *files]) == 2
    assert "r1.json: not a JSON object" in capsys.readouterr().err
    write_json(Path("r1.json"), {"name": "a"})
    settings = json.dumps({"table": "clouds", "names": ["r1.json"]})
    assert job(["results_table", settings, *files]) == 2
    assert "r1.json: not the description of a prepared cloud" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    [
        '{"job": "a"}',
        '{"job": {"a": 1}}',
        '{"job": "a',
        '{"job": "a", "processor_s": 1, "wall_s": 1, "peak_mib": 1, "ended": "x"}',
    ],
)
def test_a_log_that_ends_in_another_object_is_refused(line: str) -> None:
    Path("a.log").write_text(f"said\n{line}")
    with pytest.raises(InputError, match=r"^a.log: "):
        read_cost(Path("a.log"))


def test_a_table_of_results_without_columns_of_reference_results_is_refused() -> None:
    write_study(Path("study.parquet"))
    metadata = parquet.read_schema("study.parquet").metadata
    table = pa.Table.from_pandas(pd.DataFrame({"codec": ["draco"]}), preserve_index=False)
    parquet.write_table(table.replace_schema_metadata(metadata), "study.parquet")
    with pytest.raises(InputError, match=r"study.parquet: not reference results, without dataset"):
        read_reference("study.parquet")
    write_table(rows_of("draco", 1.0), Path("plain.parquet"))
    with pytest.raises(InputError, match=r"plain.parquet: not a file of reference results"):
        read_reference("plain.parquet")
