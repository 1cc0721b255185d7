"""The kit of conformance streams: what it lists, and how it judges a decoder."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from gpcc import conformance_streams, decode_rows, verdicts
from gpcc.conformance import FOLDER, CrashError, digest
from pointkit.errors import InputError

STREAMS = conformance_streams()
SMALL = [stream for stream in STREAMS if stream.name in {"one_ctc", "spin_one", "trees_two"}]


def test_every_stream_is_listed_and_there() -> None:
    files = set(FOLDER.rglob("*.bin"))
    assert len(STREAMS) == len(files)
    assert {stream.path for stream in STREAMS} == files
    kinds = {stream.name: stream.tools for stream in STREAMS}
    assert kinds["one_ctc"] == "octree"
    assert kinds["spin"] == "angular octree"
    assert kinds["trees_two"] == "trees"
    assert kinds["turn_0"] == "angular trees"
    assert kinds["attributes/angular"] == "attributes"


def test_the_digest_does_not_depend_on_the_order() -> None:
    points = np.array([[1.0, 2, 3], [-0.0, 5, 6], [0, 4, 6]])
    assert digest(points) == digest(points[[2, 0, 1]])
    assert digest(points) != digest(points + 1)


def test_points_alone_do_not_pass_for_attributes() -> None:
    stream = next(stream for stream in STREAMS if stream.name == "attributes/raht")
    (verdict,) = verdicts(lambda data: decode_rows(data)[:, :3], [stream])
    assert (verdict.outcome, verdict.why) == ("refused", "no values of the attributes")


def test_our_decoder_passes_but_for_the_tools_that_it_does_not_have() -> None:
    judged = list(verdicts(decode_rows, STREAMS))
    refused = {verdict.stream.name for verdict in judged if verdict.outcome == "refused"}
    assert refused == {"bytewise_minimal", "trisoup", "quantised_in_loop"}
    assert {verdict.outcome for verdict in judged} == {"decoded", "refused"}
    assert len(judged) == len(STREAMS)


def test_a_decoder_that_crashes_or_gives_other_points_fails() -> None:
    def crashing(stream: bytes) -> np.ndarray:
        raise CrashError("ended by signal 9")

    def wrong(stream: bytes) -> np.ndarray:
        return decode_rows(stream) + 1

    def short(stream: bytes) -> np.ndarray:
        return decode_rows(stream)[1:]

    for decode, why in ((crashing, "signal 9"), (wrong, "other points"), (short, "in place of")):
        (verdict,) = verdicts(decode, SMALL[:1])
        assert verdict.outcome == "failed"
        assert why in verdict.why


def test_a_manifest_may_be_a_list(tmp_path: Path) -> None:
    rows = []
    for stream in SMALL:
        shutil.copy(stream.path, tmp_path / f"my.{stream.name}.bin")
        rows.append(
            {
                "name": f"my.{stream.name}",
                "options": list(stream.options),
                "points_out": stream.points,
                "decoded_sorted_float64_sha256": stream.digest,
            }
        )
    (tmp_path / "manifest.json").write_text(json.dumps(rows))
    listed = conformance_streams(tmp_path)
    assert [stream.tools for stream in listed] == ["octree", "angular octree", "trees"]
    assert {verdict.outcome for verdict in verdicts(decode_rows, listed)} == {"decoded"}
    del rows[0]["decoded_sorted_float64_sha256"]
    (tmp_path / "manifest.json").write_text(json.dumps(rows))
    with pytest.raises(InputError, match="not a manifest of streams"):
        conformance_streams(tmp_path)


def test_a_folder_without_a_manifest_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"manifest\.json"):
        conformance_streams(tmp_path)
