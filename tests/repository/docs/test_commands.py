"""Commands and configurations that the pages show: each is run, or read as its program reads it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh
import yaml
from snakemake.cli import get_argument_parser, parse_config
from snakemake.utils import update_config

from cloud_files.clouds import read_cloud
from cloud_files.meshes import read_mesh
from pointkit.lidar.returns import read_firings
from puckbench.cli import _parser, main
from puckbench.planning.config import checked
from puckbench.planning.workflow import Workflow
from tests.cloud_files.test_cloud_formats import write_las
from tests.puckbench.recordings.test_message_returns import turn
from tests.puckbench.recordings.test_ouster import recorded
from tests.support.bench import BOX
from tests.support.cloud_bags import cloud_bag
from tests.support.cloud_turns import turns
from tests.support.pages import ROOT, blocks, commands, page, write_files
from tests.support.spinning import pcap, spin

PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    "config/README.md",
    *(
        str(path.relative_to(ROOT))
        for folder in ("how-to", "explanation")
        for path in sorted((ROOT / "docs" / folder).rglob("*.md"))
    ),
]
STORE = "docs/how-to/store_a_recording.md"
CALIBRATE, RECORDING = "docs/how-to/calibrate.md", "docs/how-to/use_a_recording.md"
WEIGHTS = "src/pcc_networks/weights/pcgcv2_objects.safetensors"

# Languages of code that other tests run, and of what is no code.
ELSEWHERE = {"python", "toml", "snakemake", "{toctree}"}

# First words of commands that cannot be tried here, and why.
NOT_TRIED = {
    ".": "activates the environment of `make setup`",
    "apptainer": "needs Apptainer",
    "docker": "needs Docker",
    "pip": "installs a wheel, as tests/puckbench/workflow/test_wheel.py does",
    "cd": "copies a run to the disk of a cluster's node",
    "rsync": "copies it back",
    "tmc3": "is MPEG's program, which is not installed",
}

# Configurations of data that no test has: they are checked, and not planned.
DATA = {
    "config/capod.yaml": "CAPOD",
    "config/real.yaml": "what `make data` fetches",
    "config/real_drives.yaml": "what `puckbench data` fetches",
    "config/thesis.yaml": "licensed data",
}


COMMANDS = {shlex.join(words): words for name in PAGES for words in commands(name)}


def _with(program: str) -> pytest.MarkDecorator:
    """Parametrised by the pages' commands of a program, without its name."""
    values = {line: words[1:] for line, words in COMMANDS.items() if words[0] == program}
    assert values
    return pytest.mark.parametrize("words", values.values(), ids=values)


def test_every_block_of_code_is_of_a_kind_that_is_tested() -> None:
    for name in PAGES:
        fences = re.findall(r"^```(.*)$", page(name), re.MULTILINE)
        assert set(fences[::2]) <= ELSEWHERE | {"sh", "yaml"}, name
    programs = {words[0] for words in COMMANDS.values()}
    assert programs == {"make", "puckbench", "snakemake", *NOT_TRIED}


@_with("make")
def test_make_has_the_target(words: list[str]) -> None:
    targets = re.findall(r"^([\w-]+):", page("Makefile"), re.MULTILINE)
    assert set(words) <= set(targets)


@_with("puckbench")
def test_the_command_has_the_options(words: list[str]) -> None:
    if words != ["--help"]:
        _parser(words)[0].parse_args(words)


@_with("snakemake")
def test_the_run_is_valid(words: list[str]) -> None:
    options = get_argument_parser(profiles=[]).parse_args(words)
    rules = {
        rule
        for file in [ROOT / "workflow" / "Snakefile", *(ROOT / "workflow" / "rules").glob("*.smk")]
        for rule in re.findall(r"^ *rule (\w+):$", file.read_text(), re.MULTILINE)
    }
    assert all(target in rules or target.startswith("results/") for target in options.targets)
    files = list(map(str, options.configfile or ["config/config.yaml"]))
    config: dict[str, Any] = {}
    for name in files:
        update_config(config, yaml.safe_load(page(name)))
    config |= parse_config(options.config)
    checked(config)
    if config.get("stand_in") or not set(files) & set(DATA):
        Workflow(config)


@pytest.fixture
def with_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with the files that the pages' configurations name."""
    (meshes := tmp_path / "data" / "mine").mkdir(parents=True)
    (meshes / "box.off").write_text(BOX)
    (office := tmp_path / "data" / "rooms" / "office").mkdir(parents=True)
    (office / "r101.txt").write_text("6 4 3")
    (tmp_path / "site").mkdir()
    write_las(tmp_path / "site" / "a.laz")
    capture = ROOT / "tests" / "data" / "capture" / "single.pcap"
    (tmp_path / "data" / "office.pcap").symlink_to(capture)
    (recordings := tmp_path / "data" / "recordings").mkdir()
    packets = [bytes(packet) for packet in spin(packets=60)]
    (recordings / "drive.pcap").write_bytes(pcap(packets))
    (tmp_path / "mine.safetensors").symlink_to(ROOT / WEIGHTS)
    write_files(tmp_path, *PAGES)
    monkeypatch.chdir(tmp_path)
    return tmp_path


CONFIGURATIONS = {
    f"{name}, {number}": block
    for name in PAGES
    if name != "CONTRIBUTING.md"  # run by test_contributing.py
    for number, block in enumerate(blocks(name, "yaml"), 1)
}


@pytest.mark.usefixtures("with_files")
@pytest.mark.parametrize("block", CONFIGURATIONS.values(), ids=CONFIGURATIONS)
def test_a_configuration_is_planned(block: str) -> None:
    shown = yaml.safe_load(block)
    scenes = shown.get("scene_sets", {"rooms": {"loader": "embedded_rooms"}})
    others = {"clouds": {"scene_set": next(iter(scenes)), "make": "sample"}}
    Workflow({"scene_sets": scenes, "datasets": others, "codecs": {"gpcc": {}}} | shown)


@pytest.fixture
def recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Write recordings of a virtual sensor in an empty room, level or tilted."""
    monkeypatch.chdir(tmp_path)
    Path("room.off").write_text(BOX)
    trimesh.load("room.off").export("room.ply")

    def write(*names: str, pitch_deg: int = 0) -> None:
        pose = f'"pitch_start_deg": {pitch_deg}, "pitch_end_deg": {pitch_deg}'
        for seed, name in enumerate(names):
            sweep = f'{{"preset": "spin", "duration_s": 0.6, "azimuth_step_deg": 0.8, {pose}}}'
            noise = ["--errors", "vlp16", "--error-options", '{"bias_redrawn": "scan"}']
            words = ["scan", "room.ply", "scan.parquet", "--sweep", sweep, *noise]
            assert main([*words, "--seed", str(seed)]) == 0
            assert main(["export", "scan.parquet", name]) == 0

    return write


def _run(name: str, *others: str) -> None:
    """Run the page's commands of puckbench, one after the other, but for some subcommands."""
    for words in commands(name):
        if words[0] == "puckbench" and words[1] not in others:
            assert main(words[1:]) == 0, words


def test_the_readme_and_the_codecs_pages_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    _run("README.md", "run", "--help")  # tests/puckbench/workflow/test_examples.py starts its runs
    assert "truth_cd_plane" in capsys.readouterr().out
    size, packed = (Path(f"recording.{end}").stat().st_size for end in ("pcap", "puck"))
    assert 0 < 10 * packed < size
    for path in sorted((ROOT / "docs" / "explanation" / "codecs").glob("*.md")):
        if "puckbench data" not in path.read_text():  # which fetches the weights of others
            _run(str(path.relative_to(ROOT)))
    assert len(read_mesh(Path("planes.ply")).triangles) > 100


def test_a_calibration_runs(recordings: Callable[..., None]) -> None:
    recordings("first.pcap", "second.pcap")
    _run(CALIBRATE)
    assert yaml.safe_load(Path("both.yaml").read_text())["provenance"]["counts"]["devices"] == 2


def test_a_recording_is_used(recordings: Callable[..., None]) -> None:
    recordings("room.pcap")
    recordings("tilted.pcap", pitch_deg=30)
    samples = Path("data/ouster_recordings")
    samples.mkdir(parents=True)
    sample = "OS-2-32-U0_v2.0.0_1024x10"
    for part in (ouster := recorded(samples, "LEGACY")), ouster.with_suffix(".json"):
        part.rename(samples / f"{sample}{part.suffix}")
    cloud_bag(Path("drive.mcap"), {"/points": [turn("velodyne") for _ in range(8)], "/rear": []})
    _run(RECORDING, "data", "run")
    assert len(read_cloud("cloud.pcd")) == len(turn("velodyne"))
    assert len(read_cloud("turns.ply")) == len(read_firings(Path("turns.parquet"))) > 1000


def test_a_recording_is_stored(recordings: Callable[..., None]) -> None:
    recordings("room.pcap")
    cloud_bag(Path("drive.mcap"), {"/points": turns(2)})
    _run(STORE)
    assert Path("again.pcap").read_bytes() == Path("room.pcap").read_bytes()
    for code in blocks(STORE, "python"):
        exec(compile(code, STORE, "exec"), {})  # noqa: S102
