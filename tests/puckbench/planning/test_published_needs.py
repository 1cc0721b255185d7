"""Which runs have the table and the section of published numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pointkit.errors import InputError
from puckbench.planning.workflow import Workflow


def _config(**changed: Any) -> dict[str, Any]:
    rooms = {"loader": "embedded_rooms", "select": ["office_1"]}
    return {
        "scene_sets": {"rooms": {**rooms, "stand_in": rooms}},
        "datasets": {
            "rooms": {"scene_set": "rooms", "make": "sample", "points": 1000, **changed},
            "others": {"scene_set": "rooms", "make": "sample", "points": 1000},
        },
        "codecs": {"draco": {}},
    }


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_run_with_a_published_data_set_has_the_table() -> None:
    outputs = Workflow(_config(published="S3DIS")).outputs
    assert set(outputs.tables["published"]) == {"metrics", "clouds"}
    assert outputs.table_options("published") == {"datasets": {"rooms": "S3DIS"}}
    assert "published" in outputs.report_contents.tables
    assert "published" not in Workflow(_config()).outputs.tables


def test_stand_ins_are_no_published_data_set() -> None:
    config = {**_config(published="S3DIS"), "stand_in": True}
    assert "published" not in Workflow(config).outputs.tables


def test_an_unknown_published_data_set_is_refused_before_anything_runs() -> None:
    with pytest.raises(InputError, match=r"^datasets.rooms.published: no published data set 'S3D'"):
        _ = Workflow(_config(published="S3D")).outputs.tables
