"""Old import paths fail with a line that names the new ones."""

import importlib

import pytest

MOVED = {
    "puckbench.gpcc": "gpcc",
    "puckbench.puck.recording": "puck",
    "puckbench.learned.pcgcv1": "pcc_networks",
    "puckbench.primitives": "primitive_codec",
    "puckbench.datasets.base": "puckbench.scene_sets",
    "puckbench.scenes.rooms": "virtual_lidar.scenes",
    "puckbench.thesis": "jenco2022",
    "puckbench.core.errors": "pointkit.errors",
    "puckbench.geometry.cloud": "pointkit.geometry",
    "puckbench.lidar.recordings.packets": "puck.recordings",
    "puckbench.io.ply": "cloud_files",
}


@pytest.mark.parametrize("old", MOVED)
def test_an_old_path_names_the_new_one(old: str) -> None:
    with pytest.raises(ImportError, match="has moved: import it from") as raised:
        importlib.import_module(old)
    (line,) = str(raised.value).splitlines()
    assert MOVED[old] in line
    importlib.import_module(MOVED[old])


def test_an_engine_that_was_a_name_of_puckbench_is_named_too() -> None:
    with pytest.raises(ImportError, match=r"puckbench\.gpcc has moved: import it from gpcc"):
        from puckbench import gpcc  # noqa: F401


def test_another_missing_module_is_just_missing() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"No module named 'puckbench\.wobble'"):
        importlib.import_module("puckbench.wobble")
