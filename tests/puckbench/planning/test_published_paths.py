"""Names of files in bundles tell nothing of the machine."""

from __future__ import annotations

from pathlib import Path

import pytest

from pointkit.errors import InputError
from puckbench.planning.published_paths import PublishedPaths


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A working folder, with files beside it."""
    for name in (
        *("work/clouds/a.xyz", "work/codecs/grid.py", "data/scans/a.las", "data/scans/b.las"),
        *("lib/codecs/other.py", "lib/pack/__init__.py", "lib/pack/inner.py", "ply/x/y.ply"),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path / "work"


def test_relative_paths_stay(folder: Path) -> None:
    config = {
        "path": ["clouds/*.xyz", "clouds"],
        "class": "codecs/grid.py:Grid",
        "topic": "/points",
    }
    paths = PublishedPaths(config, folder)
    assert paths.in_values(config) == config
    assert paths.names_of(folder / "clouds" / "a.xyz") == ["clouds/a.xyz"]


def test_absolute_paths_of_the_folder_become_relative(folder: Path) -> None:
    config = {"path": f"{folder}/clouds/a.xyz", "class": f"{folder}/codecs/grid.py:Grid"}
    paths = PublishedPaths(config, folder)
    assert paths.in_values(config) == {"path": "clouds/a.xyz", "class": "codecs/grid.py:Grid"}
    assert paths.in_text(f"see {folder}/clouds/b.xyz, in {folder}") == "see clouds/b.xyz, in ."


def test_files_elsewhere_keep_their_names_and_those_of_their_folders(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    data = folder.parent / "data"
    config = {
        "path": [f"{data}/scans/a.las", "../ply/*/y.ply"],
        "units": {f"{data}/scans/a.las": 0.001},
        "class": f"{folder.parent}/lib/codecs/other.py:Other",
        "metrics": [f"{folder.parent}/lib/pack/inner.py:metric"],
    }
    paths = PublishedPaths(config, folder)
    assert paths.in_values(config) == {
        "path": ["elsewhere/scans/a.las", "elsewhere_2/ply/*/y.ply"],
        "units": {"elsewhere/scans/a.las": 0.001},
        "class": "elsewhere_3/other.py:Other",
        "metrics": ["elsewhere_4/pack/inner.py:metric"],
    }
    assert paths.names_of(data / "scans" / "a.las") == ["elsewhere/scans/a.las"]
    assert paths.names_of(Path("../ply/x/y.ply")) == ["elsewhere_2/ply/x/y.ply"]
    assert paths.names_of(data / "poses.txt") == ["elsewhere/poses.txt"]
    line = f"{data}/scans/a.las: damaged, unlike {data}/scans/a.laser"
    assert paths.in_text(line).startswith("elsewhere/scans/a.las: damaged")
    with pytest.raises(InputError, match="not in the folder of the run"):
        paths.names_of(Path("/nowhere/x.las"))


def test_a_name_that_is_taken_is_not_used(folder: Path) -> None:
    (folder / "elsewhere").mkdir()
    config = {"path": f"{folder.parent}/data/scans"}
    paths = PublishedPaths(config, folder)
    assert paths.in_values(config) == {"path": "elsewhere_2/scans"}
