"""Pictures of the documentation are of the shipped results, and none is forgotten."""

from __future__ import annotations

import json
import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from benchmarks.clouds import scanned_room
from PIL import Image

from cloud_files.clouds import write_cloud
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.steps.preparation import prepare
from tests.support.pages import ROOT
from virtual_lidar.scenes.rooms import make_room

sys.path.append(str(ROOT / "docs" / "extensions"))
pictures: Any = import_module("pictures")


@pytest.mark.parametrize("name", pictures.PICTURES)
def test_a_picture_is_as_new_as_its_data(name: str) -> None:
    found = pictures.stamp_in(pictures.PICTURES_FOLDER / f"{name}.png")
    assert found == pictures.stamp(pictures.PICTURES[name]), "older than its data: run `make pages`"


def test_every_picture_is_drawn_or_says_why_not_and_is_on_a_page() -> None:
    files = {path.stem for path in pictures.PICTURES_FOLDER.glob("*.png")}
    assert files == pictures.PICTURES.keys() | pictures.NOT_SHIPPED.keys()
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    shown = re.findall(r"pictures/(\w+)\.png", "\n".join(path.read_text() for path in pages))
    assert set(shown) == files


def test_a_picture_of_a_table_carries_the_digest_of_its_file(tmp_path: Path) -> None:
    pictures.write_picture("noise_cost", tmp_path / "a.png", tmp_path)
    pictures.write_picture("noise_cost", tmp_path / "b.png", tmp_path)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    about = json.loads(pictures.stamp_in(tmp_path / "a.png") or "")
    assert (about["figure"], list(about["data"])) == ("noise_cost", ["evidence.parquet"])
    with Image.open(tmp_path / "a.png") as image:
        assert set(image.info) <= {pictures.KEY, "dpi"}


def test_a_picture_is_not_drawn_of_another_cloud(tmp_path: Path) -> None:
    for name in json.loads(pictures.stamp(pictures.PICTURES["rooms"]))["data"]:
        write_cloud(tmp_path / "clouds" / f"{name}.ply", _room())
    with pytest.raises(InputError, match=r"rooms_raw/.*not the cloud of the reference results"):
        pictures.write_picture("rooms", tmp_path / "rooms.png", tmp_path)
    assert not (tmp_path / "rooms.png").exists()


def test_other_data_or_another_figure_change_the_stamp() -> None:
    stamps = {
        pictures.stamp(pictures.Picture(*of))
        for of in (("a", "default"), ("b", "default"), ("a", "sweeps"))
    }
    assert len(stamps) == 3


def test_the_largest_distances_are_on_the_scale_of_the_picture_of_primitives() -> None:
    figure = pictures.draw_primitives(_room(), make_room("office_1", seed=1), "r1")
    titles = [axes.get_title() for axes in figure.axes[:4]]
    most = [float(re.findall(r"at most (\d+) mm", titles[place])[0]) for place in (0, 3)]
    low, high = figure.axes[4].get_ylim()
    assert low == 1.0
    assert high == pytest.approx(max(*most, 10.0), abs=0.5)


def test_an_unknown_picture_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["pictures", "nothing"])
    with pytest.raises(SystemExit):
        pictures.main()
    assert "no picture nothing (known: rooms, " in capsys.readouterr().err


def _room() -> PointCloud:
    return prepare(PointCloud(scanned_room("vlp16_divergence", 3.0)))
