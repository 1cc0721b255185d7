"""Every script in benchmarks/ starts and ends well on tiny input."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.learned_codecs import lizip_file, lpcm_repository
from tests.support.spinning import VLP16, pcap, spin

ROOT = Path(__file__).parents[3]
STARTED: dict[str, tuple[str, ...]] = {
    "claims.dense": (),
    "claims.lidar": ("--scenes", "1", "--step-deg", "8"),
    "claims.order": ("--scenes", "1", "--step-deg", "8"),
    "claims.packets": ("--rooms", "1", "--turns", "1"),
    "claims.turns_of_a_drive": ("{turn}", "--steps-mm", "500"),
    "checks.calibration_recovery": ("--repetitions", "1", "--hidden", "device", "--step-deg", "6"),
    "checks.error_models": ("{trainings}",),
    "checks.fuzz": ("--streams", "2", "--codecs", "draco", "--only", "codecs"),
    "checks.gpcc_angular_crosscheck": ("{tmc3}", "--turns", "two points", "--modes", "slices"),
    "checks.gpcc_attribute_vectors": ("{tmc3}", "{folder}", "--only", "nearest"),
    "checks.gpcc_crosscheck": (
        "{tmc3}",
        "--clouds",
        "one point",
        "--profiles",
        "minimal",
        "--rates",
        "e8",
    ),
    "checks.gpcc_predictive_crosscheck": ("{tmc3}", "--turns", "two points", "--modes", "as given"),
    "checks.gpcc_vectors": ("{tmc3}", "{folder}", "--only", "two_minimal"),
    "checks.killed_runs": ("--kills", "1", "--target", "{cloud}"),
    "checks.metrics_vs_pc_error": ("{pc_error}", "--repeats", "1", "--points", "5000"),
    "checks.inter_lpcm": ("{lpcm}", "--turns", "2"),
    "checks.inter_lpcm --plain": ("{lpcm}", "--turns", "1"),
    "checks.recorded_noise": ("{capture}",),
    "checks.lizip_order": ("{lizip_weights}", "{lizip_frame}"),
    "checks.mutants": ("puckbench/metrics/density", "--each", "1"),
    "performance.codecs": (
        *("turn", "--codecs", "draco", "puck", "--rates", "10mm", "--repeats", "1"),
        *("--points", "1000"),
    ),
    "performance.gpcc": ("{tmc3}", "--repeats", "1", "--step", "8", "--modes", "angular"),
    "performance.default_run": ("results/clouds/objects/chair_02.ply",),
    "performance.live_turns": ("write", "{folder}/live.puck", "{capture}", "--packets", "1000"),
    "performance.measure": (
        *("--trial", "--results", "{folder}/measured.json", "--recordings", "{capture}"),
        *("--tmc3", "{tmc3}", "--pc-error", "{pc_error}"),
        *("scans", "puck", "clouds", "gpcc", "codecs", "metrics"),
    ),
    "performance.ouster": ("{capture}", "--repeats", "1"),
    "performance.planning": ("{small}",),
    "performance.puck": ("{capture}", "--repeats", "0"),
    "performance.scale": (
        *("recording", "folder", "--points", "2000", "--megabytes", "0.1", "--clouds", "1"),
        *("--run", "--codecs", "draco", "--cores", "2"),
    ),
    "performance.scan_speed": ("--errors", "none", "--repeats", "1", "--step", "8"),
    "performance.start": ("--repeats", "1"),
    "same_results": ("{folder}", "{folder}"),
}
"""Script, with an option if it is started twice -> its arguments; names in braces are those of
`files`."""
NOT_STARTED = {
    "checks.blender.cast": "needs Blender's Python",
    "checks.blender.compare": "needs Blender's Python",
    "claims.scenes": "is a module of the scripts",
    "clouds": "is a module of the scripts",
    "performance.clouds": "is started by performance.measure",
    "performance.rows": "is a module of the scripts",
    "tmc3": "is a module of the scripts",
    "turns": "is a module of the scripts",
}
PC_ERROR = """#!/bin/sh
for kind in p2point p2plane; do
    for name in "mse1     " "mse2     " "mseF     " "h.     "; do echo "$name ($kind): 1.0"; done
done
echo "Job done! 0.1 seconds"
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("benchmarks")
    programs = {
        "tmc3": f'#!/bin/sh\nexec {sys.executable} -m tests.support.tmc3_stand_in "$@"\n',
        "pc_error": PC_ERROR,
    }
    (folder / "trainings" / "segmentation").mkdir(parents=True)
    for name in ("none-1", "none-2", "vlp16-1", "vlp16-2"):
        card = {"validation": {"real": {"miou": 0.25}}}
        (folder / "trainings" / "segmentation" / f"{name}.json").write_text(json.dumps(card))
    for name, text in programs.items():
        (folder / name).write_text(text)
        (folder / name).chmod(0o755)
    (folder / "mlp.bin").write_bytes(lizip_file())
    (folder / "frame.bin").write_bytes(np.ones((200, 5), "<f4").tobytes())
    (folder / "turn.pcap").write_bytes(pcap([bytes(p) for p in spin(VLP16, packets=180)]))
    (folder / "empty").mkdir()
    angle = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    columns = [10 * np.cos(angle), 10 * np.sin(angle), 0 * angle, 0 * angle]
    np.tile(np.stack(columns, axis=1), (64, 1)).astype("<f4").tofile(folder / "turn.bin")
    return {
        "tmc3": str(folder / "tmc3"),
        "pc_error": str(folder / "pc_error"),
        "capture": str(folder / "turn.pcap"),
        "lizip_weights": str(folder / "mlp.bin"),
        "lizip_frame": str(folder / "frame.bin"),
        "folder": str(folder / "empty"),
        "turn": str(folder / "turn.bin"),
        "trainings": str(folder / "trainings"),
        "lpcm": str(lpcm_repository(folder)),
        "small": str(ROOT / "benchmarks" / "small.yaml"),
        "cloud": "results/clouds/objects/chair_01.ply",
    }


@pytest.mark.usefixtures("job_server")
@pytest.mark.parametrize("script", STARTED)
def test_a_script_runs_to_its_end(script: str, files: dict[str, str]) -> None:
    words = [word.format(**files) for word in STARTED[script]]
    command = [sys.executable, "-m", *f"benchmarks.{script}".split(), *words]
    process = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert process.returncode == 0, process.stdout + process.stderr
    assert process.stdout or script == "same_results"


def test_every_script_is_started_or_says_why_not() -> None:
    folder = ROOT / "benchmarks"
    scripts = {
        ".".join(path.relative_to(folder).with_suffix("").parts) for path in folder.rglob("*.py")
    }
    assert scripts == {key.split()[0] for key in STARTED} | NOT_STARTED.keys()


def test_the_benchmarks_stay_small() -> None:
    lines = [path.read_text().count("\n") for path in (ROOT / "benchmarks").rglob("*.py")]
    assert sum(lines) <= 5400
