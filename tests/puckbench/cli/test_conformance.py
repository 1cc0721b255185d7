"""The kit of conformance streams, on programs that are right, wrong, absent or end badly."""

import json
import shutil
import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from gpcc import decode_cloud
from gpcc.conformance import conformance_streams, verdicts
from pointkit.errors import InputError
from puckbench.cli import main
from puckbench.cli.decoding_program import program_decoder

STREAMS = conformance_streams()
SMALL = [stream for stream in STREAMS if stream.name in {"one_ctc", "spin_one", "trees_two"}]


@pytest.mark.parametrize(
    ("code", "outcome", "why"),
    [
        (
            "import shutil, sys; shutil.copy(sys.argv[1] + '.none', sys.argv[2])",
            "refused",
            "status",
        ),
        ("print('no such tool'); raise SystemExit('later lines count')", "refused", "later lines"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "failed", "signal 9"),
        ("pass", "refused", "points.ply"),
        (
            "import sys; open(sys.argv[2], 'w').write('ply\\nformat ascii 1.0\\nelement vertex '"
            "'1\\nproperty float x\\nproperty float y\\nproperty float z\\nend_header\\n1 2 3\\n')",
            "failed",
            "other points",
        ),
    ],
)
def test_a_program_is_judged_by_what_it_writes(code: str, outcome: str, why: str) -> None:
    command = f'{sys.executable} -c "{code}" {{stream}} {{points}}'
    (verdict,) = verdicts(program_decoder(command), SMALL[:1])
    assert verdict.outcome == outcome
    assert why in verdict.why


_PROGRAM = """
import sys
from hashlib import sha256
from pathlib import Path
import numpy as np
from cloud_files.ply import write_vertices
name = sha256(Path(sys.argv[1]).read_bytes()).hexdigest() + ".npz"
columns = dict(np.load(Path(__file__).with_name(name)))
CHANGE
write_vertices(Path(sys.argv[2]), columns)
"""
_NAMES = {"attributes/both", "attributes/lifting_colours", "attributes/raht"}


@pytest.fixture(scope="module")
def decoded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the decoded columns of three streams, which the program writes as its work."""
    folder = tmp_path_factory.mktemp("decoded")
    for stream in STREAMS:
        if stream.name in _NAMES:
            data = stream.path.read_bytes()
            cloud = decode_cloud(data)
            columns = dict(zip("xyz", cloud.positions().T, strict=True))
            if "color" in cloud.attributes:
                colours = cloud.attributes["color"].T
                columns |= dict(zip(("red", "green", "blue"), colours, strict=True))
            if "reflectance" in cloud.attributes:
                columns["refc"] = cloud.attributes["reflectance"]
            np.savez(folder / sha256(data).hexdigest(), **columns)
    return folder


@pytest.mark.parametrize(
    ("change", "outcomes", "why"),
    [
        ("", {"decoded"}, ""),
        ("columns['x'] = columns['x'][::-1]", {"failed"}, "other points or attributes"),
        ("columns.get('refc', columns.get('red'))[5] ^= 1", {"failed"}, "other points or attr"),
        ("columns = {axis: columns[axis] for axis in 'xyz'}", {"refused"}, "no values"),
    ],
)
def test_a_program_is_judged_by_the_attributes_too(
    decoded: Path, change: str, outcomes: set[str], why: str
) -> None:
    program = decoded / "decoder.py"
    program.write_text(_PROGRAM.replace("CHANGE", change))
    decode = program_decoder(f"{sys.executable} {program} {{stream}} {{points}}")
    judged = list(verdicts(decode, [stream for stream in STREAMS if stream.name in _NAMES]))
    assert {verdict.outcome for verdict in judged} == outcomes
    assert all(why in verdict.why for verdict in judged)


def test_a_program_that_is_not_there_is_said_so() -> None:
    with pytest.raises(InputError, match="no codec and no program 'nowhere'"):
        program_decoder("nowhere")


def test_our_decoder_passes_but_for_the_tools_that_it_does_not_have(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["conformance", "gpcc", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["failed"] == 0
    assert answer["streams"] == len(STREAMS) == answer["decoded"] + answer["refused"]
    refused = {name for name, row in answer["not decoded"].items() if row["outcome"] == "refused"}
    assert refused == {"bytewise_minimal", "trisoup", "quantised_in_loop"}


def test_a_decoder_that_is_wrong_gives_status_1(capsys: pytest.CaptureFixture[str]) -> None:
    wrong = f'{sys.executable} -c "import os; os.abort()" {{stream}} {{points}}'
    assert main(["conformance", wrong, "--tools", "angular trees"]) == 1
    assert "failed" in capsys.readouterr().out


def test_a_manifest_may_be_a_list(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = []
    for stream, wrong in zip(SMALL, ("", "", "0"), strict=True):
        shutil.copy(stream.path, tmp_path / f"my.{stream.name}.bin")
        rows.append(
            {
                "name": f"my.{stream.name}",
                "options": list(stream.options),
                "points_in": 7,
                "points_out": stream.points,
                "decoded_sorted_float64_sha256": wrong or stream.digest,
            }
        )
    (tmp_path / "manifest.json").write_text(json.dumps(rows))
    assert main(["conformance", "gpcc", "--streams", str(tmp_path), "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert (answer["streams"], answer["decoded"], answer["failed"]) == (3, 2, 1)
    assert answer["not decoded"]["my.trees_two"]["why"] == "other points"
    assert answer["not decoded"]["my.trees_two"]["tools"] == "trees"
    del rows[0]["decoded_sorted_float64_sha256"]
    (tmp_path / "manifest.json").write_text(json.dumps(rows))
    assert main(["conformance", "gpcc", "--streams", str(tmp_path)]) == 2
    assert "not a manifest of streams" in capsys.readouterr().err


def test_a_folder_without_a_manifest_is_bad_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["conformance", "gpcc", "--streams", str(tmp_path)]) == 2
    assert "manifest.json" in capsys.readouterr().err
    (tmp_path / "manifest.json").write_text('{"a": {}}')
    assert main(["conformance", "gpcc", "--streams", str(tmp_path)]) == 2
