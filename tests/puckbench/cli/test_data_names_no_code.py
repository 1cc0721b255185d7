"""Data name no code: every reader of data is given the places of a file that would leave a mark."""

from __future__ import annotations

import json
import pickle
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from cloud_files.clouds import write_cloud
from cloud_files.meshes import write_mesh
from pointkit.files import write_json
from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Labels, Primitive, SceneObject
from pointkit.tables import write_table
from puckbench.cli import main
from puckbench.report.reference_results import plain_rows, read_reference, write_reference
from puckbench.report.run_record import RunRecord
from puckbench.results.row_files import write_rows
from puckbench.steps.process import main as job
from tests.support.reference_lookalike import CLOUDS, clouds_of, rows_of, write_run
from tests.support.sensor_scenes import room

MARK = Path("mark")
PAYLOAD = "from pathlib import Path\nPath('mark').touch()\n"
STUDY: dict[str, Any] = {
    "scene_sets": {"objects": {"loader": "embedded_objects"}},
    "datasets": {"objects": {"scene_set": "objects", "make": "sample"}},
    "codecs": {"draco": {}},
}
SCAN = {"scene_set": "objects", "make": "scan"}
IS_CODE = "is code that is not loaded"
NOT_REGISTERED = r"codec '{}' is not registered: name its code with --codec '{}'"
STUDY_NAMES = r"the configuration of the study: names code, which results must not: '{}'"


class Opener:
    """Leaves the mark where it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (MARK,)


@pytest.fixture(
    params=["{}.py:Evil", "{}:Evil", "{folder}/{}.py:Evil"], ids=["file", "module", "path"]
)
def place(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A place of a file in the working folder, which is on Python's path too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    Path("payload_of_data.py").write_text(PAYLOAD)
    points = np.random.default_rng(0).random((300, 3)) * 1023
    write_cloud(Path("cloud.ply"), PointCloud(points, about={"size": 1024}))
    return str(request.param).format("payload_of_data", folder=tmp_path)


def _stream(**record: str) -> None:
    Path("stream.bin").write_bytes(b"of nobody")
    write_json(Path("stream.bin.json"), record)


def _decode(place: str) -> int:
    _stream(codec=place)
    return main(["decode", "stream.bin", "out.ply"])


def _decode_with_class(place: str) -> int:
    _stream(codec="mine", **{"class": place, "training": place})
    return main(["decode", "stream.bin", "out.ply"])


def _decode_to_mesh(place: str) -> int:
    _stream(codec=place)
    return main(["decode", "stream.bin", "out.ply", "--as-mesh"])


def _evaluate(place: str) -> int:
    _stream(codec=place)
    return main(["evaluate", "cloud.ply", "stream.bin"])


def _recover(place: str) -> int:
    surface = room()
    ids = np.zeros(len(surface.triangles), np.int32)
    item = (SceneObject("room", "wall"),), (Primitive("plane", {}),)
    write_mesh(Path("scene.ply"), replace(surface, labels=Labels(ids, ids, *item)))
    points = np.ones((1, 3))
    write_cloud(Path("points.ply"), PointCloud(points, labels=np.zeros(1, np.int32)))
    _stream(codec=place)
    return main(["recovery", "stream.bin", "points.ply", "scene.ply"])


def _encode(place: str) -> int:
    """A cloud whose description names code."""
    names = ("codec", "class", "loader", "errors", "error_model", "sensor", "metrics", "training")
    points = np.random.default_rng(0).random((300, 3)) * 1023
    about = {"size": 1024, **dict.fromkeys(names, place)}
    write_cloud(Path("named.ply"), PointCloud(points, about=about))
    return main(["encode", "named.ply", "out.bin", "--codec", "draco", "--rate", "r1"])


def _report(place: str, **contents: Any) -> int:
    return main(["report", "out.html", "--contents", json.dumps(contents)])


def _report_own_figures(place: str) -> int:
    return _report(place, own_figures=[place])


def _report_own_tables(place: str) -> int:
    return _report(place, own_tables=[place])


def _report_figures(place: str) -> int:
    return _report(place, figures={place: "a.png"})


def _report_all_else(place: str) -> int:
    """A table, results, a style and a configuration that name code, and logs of such jobs."""
    write_table(_metrics(place), Path("metrics.csv"))
    cost = {
        "job": place,
        "processor_s": 1.0,
        "wall_s": 1.0,
        "peak_mib": 1,
        "commit": place,
    }
    Path("logs").mkdir()
    Path("logs/a.log").write_text(json.dumps(cost))
    configuration = {"codecs": {place: {"class": place, "training": place}}, **_named(place)}
    return _report(
        place,
        metrics="metrics.csv",
        tables={place: "metrics.csv"},
        style=[{"codec_titles": {place: place}}],
        configuration={**configuration, "datasets": {}, "scene_sets": {}},
        logs="logs",
    )


def _named(place: str) -> dict[str, Any]:
    return {"metrics": [place], "tables": [place], "figures": {"own": [place]}}


def _figure(place: str) -> int:
    write_table(_metrics(place), Path("metrics.csv"))
    inputs = json.dumps({"metrics": "metrics.csv"})
    return main(["figure", "fig_6_6", "out.png", "--inputs", inputs])


def _table(place: str) -> int:
    write_table(_metrics(place), Path("metrics.csv"))
    inputs = json.dumps({"metrics": "metrics.csv"})
    return main(
        ["table", "bd_rate", "out.csv", "--inputs", inputs, "--options", '{"anchor": "draco"}']
    )


def _metrics(place: str) -> pd.DataFrame:
    """Results of a codec of that name."""
    rows = pd.concat([rows_of("draco", 1.0), rows_of(place, 0.5)], ignore_index=True)
    return rows.assign(cd_point=rows["d1_mse"], cd_plane=rows["d1_mse"], clouds=1)


def _compare(place: str) -> int:
    """A run and reference results with a codec of that name."""
    write_run(Path("run"), _metrics(place))
    _write_study({"codecs": {place: {"class": place}}, **_named(place)}, place)
    return main(["compare", "run", "--with", "study.parquet", "--codecs", place])


def _run_study(**configuration: Any) -> int:
    _write_study({**STUDY, **configuration})
    return main(["run", "--study", "study.parquet", "--codecs", "draco", "--out", "out"])


def _run_study_loader(place: str) -> int:
    return _run_study(scene_sets={"objects": {"loader": place}})


def _run_study_stand_in(place: str) -> int:
    scenes = {"objects": {"loader": "embedded_objects", "stand_in": {"loader": place}}}
    return _run_study(scene_sets=scenes)


def _run_study_errors(place: str) -> int:
    return _run_study(datasets={"objects": {**SCAN, "errors": place}})


def _run_study_metrics(place: str) -> int:
    return _run_study(metrics=[place])


def _run_study_tables(place: str) -> int:
    return _run_study(tables=[place])


def _run_study_figures(place: str) -> int:
    return _run_study(figures={"own": [place]})


def _run_study_all_else(place: str) -> int:
    """What is not taken of a study's configuration."""
    # The clouds are missing, so that nothing is run.
    objects = {"loader": "point_clouds", "options": {"path": "nothing"}}
    return _run_study(
        scene_sets={"objects": objects},
        datasets={"objects": {"scene_set": "objects", "make": "cloud"}},
        codecs={"mine": {"class": place, "training": place}},
        sensor_study={"models": {"mine": {"errors": place}}},
        train={"mine": {"codec": "mine", "datasets": ["objects"]}},
    )


def _write_study(configuration: Mapping[str, Any], codec: str = "draco") -> None:
    about = {
        "configuration": configuration,
        "style": [],
        "bd_rate": {"anchor": codec, "qualities": ["d1_psnr"]},
        "machine": {},
        "record": RunRecord().as_json(),
        "clouds": plain_rows(clouds_of(CLOUDS)),
    }
    write_reference(Path("study.parquet"), _metrics(codec), about)


def _scan(place: str) -> int:
    """A mesh whose description names code."""
    about = {"loader": place, "errors": place, "origin": [2, 2, 1]}
    write_mesh(Path("scene.ply"), replace(room(), labels=None), about)
    words = ["scan", "scene.ply", "out.parquet", "--sweep"]
    return main([*words, '{"preset": "spin", "azimuth_step_deg": 4}'])


def _calibrated(place: str) -> int:
    """The file of an error model."""
    code = "!!python/object/apply:os.system [touch mark]"
    head = "format: puckbench range error model 1"
    Path("model.yaml").write_text(f"{head}\nmodel: {place}\nparameters: {code}\n")
    write_mesh(Path("scene.ply"), replace(room(), labels=None))
    options = json.dumps({"file": "model.yaml"})
    words = ["scan", "scene.ply", "out.parquet", "--errors", "calibrated"]
    return main([*words, "--error-options", options])


def _calibrate(place: str) -> int:
    """A residual table whose rows name an error model."""
    from tests.support.residuals_lookalike import residual_table

    table = residual_table(per_part=20)
    models = pd.Categorical([place] * len(table))
    later = {"range_m": 1.0, "frame": 0, "plane_u_m": 0.0, "plane_v_m": 0.0}
    table.assign(model=models, **later).to_parquet("residuals.parquet")
    return main(["calibrate", "residuals.parquet", "model.yaml"])


def _pickled_array(place: str) -> int:
    np.save("cloud.npy", np.array([[Opener()] * 3], dtype=object), allow_pickle=True)
    return main(["prepare", "cloud.npy", "out.ply"])


def _pickled_archive(place: str) -> int:
    np.savez("cloud.npz", xyz=np.array([[Opener()] * 3], dtype=object))
    return main(["prepare", "cloud.npz", "out.ply"])


def _pickled_checkpoint(place: str) -> int:
    pytest.importorskip("torch")
    Path("c8_a025_32000.pth").write_bytes(pickle.dumps({"model": Opener()}))
    words = ["encode", "cloud.ply", "out.bin", "--codec", "pcgcv2", "--rate", "r1"]
    return main([*words, "--weights", "c8_a025_32000.pth"])


def _weights(place: str) -> int:
    """A set of weights whose header names code."""
    from safetensors.numpy import save_file

    card = {"codec": place, "training": place}
    header = {"network": place, "shape": {}, "lmbdas": [1.0], "card": card, "sha256": ""}
    save_file({"a": np.zeros(1, "<f2")}, "w.safetensors", {"puckbench": json.dumps(header)})
    words = ["encode", "cloud.ply", "out.bin", "--codec", "pcgcv2_plus", "--rate", "r1"]
    return main([*words, "--weights", "w.safetensors"])


def _start_of_training(place: str) -> int:
    from safetensors.numpy import save_file

    header = {"network": place, "shape": {}, "lmbdas": [1.0], "card": {"training": place}}
    save_file({}, "w.safetensors", {"puckbench": json.dumps({**header, "sha256": ""})})
    words = ["train", "cloud.ply", "--out", "out.safetensors", "--steps", "1"]
    return main([*words, "--start", "w.safetensors"])


def _manifest(place: str) -> int:
    """Streams for a decoder."""
    about = {"options": [], "points_out": 1, "decoder": place, "sha256_sorted_float64": place}
    write_json(Path("manifest.json"), {place.replace("/", "_"): about})
    return main(["conformance", "gpcc", "--streams", "."])


def _rows_of_a_run(place: str) -> int:
    """Result rows that become a table."""
    row = {"dataset": "a", "cloud": "b", "rate": "r1", "codec": place, "class": place, "bpp": 1.0}
    write_rows(Path("rows.parquet"), [row])
    settings = json.dumps({"table": "metrics", "names": ["rows.parquet"]})
    files = ("results=.", "csv=a.csv", "parquet=a.parquet", "columns=columns.csv")
    return job(["results_table", settings, *files])


def _job(place: str) -> int:
    """The name of a step, which is one of ours."""
    return job([place, "{}"])


READERS: dict[Callable[[str], int], str | None] = {
    _decode: NOT_REGISTERED,
    _decode_with_class: "codec 'mine' is not registered.* with --codec path/to/file.py:Class",
    _decode_to_mesh: NOT_REGISTERED,
    _evaluate: NOT_REGISTERED,
    _recover: NOT_REGISTERED,
    _encode: None,
    _report_own_figures: rf"figure: '{{}}' {IS_CODE}",
    _report_own_tables: rf"table: '{{}}' {IS_CODE}",
    _report_figures: rf"figure: '{{}}' {IS_CODE}",
    _report_all_else: None,
    _figure: None,
    _table: None,
    _compare: None,
    _run_study_loader: STUDY_NAMES,
    _run_study_stand_in: STUDY_NAMES,
    _run_study_errors: STUDY_NAMES,
    _run_study_metrics: STUDY_NAMES,
    _run_study_tables: STUDY_NAMES,
    _run_study_figures: STUDY_NAMES,
    _run_study_all_else: "nothing: no such",
    _scan: None,
    _calibrated: "model.yaml: line 3: not valid YAML",
    _calibrate: "more lasers are needed",
    _pickled_array: "cloud.npy",
    _pickled_archive: "cloud.npz",
    _pickled_checkpoint: "c8_a025_32000.pth",
    _weights: "w.safetensors|weights",
    _start_of_training: "w.safetensors",
    _manifest: None,
    _rows_of_a_run: None,
    _job: rf"step: '{{}}' {IS_CODE}",
}
"""What reads data, and the line in which it refuses them, with the place; None where it takes the
names as those of something that it does not know."""


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.__name__.strip("_"))
def test_data_name_no_code(
    reader: Callable[[str], int], place: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = set(sys.modules)
    status = reader(place)
    said = capsys.readouterr().err
    assert not MARK.exists()
    assert not [name for name in sys.modules if "payload_of_data" in name and name not in before]
    line = READERS[reader]
    if line is None:
        assert status == 0, said
        return
    assert (status, said.count("\n")) == (2, 1), said
    assert re.search(line.replace("{}", re.escape(place)), said), said


def test_the_mark_is_left_by_who_loads_the_file(place: str) -> None:
    """Else the tests above would prove nothing."""
    words = ["encode", "cloud.ply", "out.bin", "--rate", "r1", "--codec", place]
    assert main(words) == 2  # it has no such class
    assert MARK.exists()
    sys.modules.pop("payload_of_data", None)


def test_the_reference_results_of_the_test_are_read(place: str) -> None:
    _write_study(STUDY)
    assert read_reference("study.parquet").name == "study"
