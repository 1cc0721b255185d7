"""Where `pcc_networks` is not installed, all but the learned codecs work, and these say why not."""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

from cloud_files.clouds import read_cloud, write_cloud
from pointkit.geometry.cloud import PointCloud
from puckbench.core.packages import package_folders

LEARNED = (
    *("pcgcv1", "pcgcv1_plus", "pcgcv2", "pcgcv2_plus", "pcgcv2_plus_rooms", "reno"),
    *("inter_lpcm", "lizip", "polopcac", "sparse_octree_net"),
)
MISSING = "pcc_networks not installed: pip install 'puckbench[learned]'"


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables with which Python finds all that is installed here but `pcc_networks`."""
    folder = tmp_path_factory.mktemp("packages")
    for installed in Path(sysconfig.get_path("purelib")).iterdir():
        if not installed.name.startswith(("pcc_networks", "__editable__")):
            (folder / installed.name).symlink_to(installed)
    for name, package in package_folders().items():
        if name != "pcc_networks" and not (folder / name).exists():
            (folder / name).symlink_to(package)
    return {**os.environ, "PYTHONPATH": str(folder)}


def _run(environment: dict[str, str], *words: str | Path) -> subprocess.CompletedProcess[str]:
    # -S: the environment's own folder of packages stays out of the path
    command = [sys.executable, "-S", "-m", "puckbench", *map(str, words)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def test_learned_codecs_are_listed_with_what_to_install(environment: dict[str, str]) -> None:
    listed = _run(environment, "codecs", "--json")
    assert listed.returncode == 0, listed.stderr
    table = json.loads(listed.stdout)
    assert {name for name, entry in table.items() if "pcc_networks" in entry["why"]} == set(LEARNED)
    assert all(table[name]["why"].startswith(MISSING) for name in LEARNED)
    assert table["gpcc"]["available"]


def test_gpcc_codes_and_a_learned_codec_is_refused_in_one_line(
    environment: dict[str, str], tmp_path: Path
) -> None:
    points = np.random.default_rng(0).integers(0, 1024, (500, 3)).astype(float)
    cloud, stream, decoded = (tmp_path / name for name in ("a.ply", "a.bin", "b.ply"))
    write_cloud(cloud, PointCloud(points, about={"size": 1024}))
    coded = _run(environment, "encode", cloud, stream, "--codec", "gpcc", "--rate", "r8")
    assert coded.returncode == 0, coded.stderr
    assert _run(environment, "decode", stream, decoded).returncode == 0
    assert np.array_equal(np.unique(read_cloud(decoded).xyz, axis=0), np.unique(points, axis=0))
    for words in (
        ("encode", cloud, tmp_path / "c.bin", "--codec", "pcgcv2_plus", "--rate", "r1"),
        ("encode", cloud, tmp_path / "c.bin", "--codec", "sparse_octree_net", "--rate", "r1"),
        ("train", cloud, "--codec", "pcgcv2_plus", "--out", tmp_path / "mine.safetensors"),
    ):
        refused = _run(environment, *words)
        assert refused.returncode == 2
        assert MISSING in refused.stderr.splitlines()[-1]
        assert "Traceback" not in refused.stderr


def test_a_configuration_with_learned_codecs_is_planned(
    environment: dict[str, str], tmp_path: Path
) -> None:
    program = """
import sys
from importlib.util import find_spec
from puckbench.planning.workflow import Workflow
assert find_spec("pcc_networks") is None
config = {
    "scene_sets": {"a": {"loader": "embedded_objects", "select": ["chair_01"]}},
    "datasets": {"d": {"scene_set": "a", "make": "sample"}},
    "codecs": {"pcgcv2_plus": {}, "sparse_octree_net": {}, "draco": {}},
}
print(len({curve[-1] for curve in Workflow(config).plan.curves}))
"""
    done = subprocess.run(
        [sys.executable, "-S", "-c", program],
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout.strip()) == (0, "3"), done.stderr
