from contextlib import suppress
from pathlib import Path

import pytest

from puckbench.errors import InputError
from puckbench.files import read_json, sha256, write_bytes, write_json, written_whole


def test_a_failed_write_leaves_the_old_file_and_no_temporary(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    write_bytes(path, b"old")
    with suppress(RuntimeError), written_whole(path) as temporary:
        temporary.write_bytes(b"half")
        raise RuntimeError
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_folders_are_made_and_the_temporary_keeps_the_suffix(tmp_path: Path) -> None:
    with written_whole(tmp_path / "deep" / "b.ply") as temporary:
        assert temporary.suffix == ".ply"
        temporary.write_text("x")
    assert (tmp_path / "deep" / "b.ply").read_text() == "x"


def test_json_is_the_same_whatever_the_order_of_the_keys(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"b": 1, "a": [0.1]})
    write_json(tmp_path / "b.json", {"a": [0.1], "b": 1})
    assert sha256(tmp_path / "a.json") == sha256(tmp_path / "b.json")
    assert read_json(tmp_path / "a.json") == {"a": [0.1], "b": 1}


def test_json_refuses_nan(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", {"a": float("nan")})
    assert not (tmp_path / "a.json").exists()


@pytest.mark.parametrize(("content", "fault"), [(b"{", "not valid JSON"), (None, "no such file")])
def test_unreadable_json_is_named(tmp_path: Path, content: bytes | None, fault: str) -> None:
    path = tmp_path / "c.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=rf"c\.json: {fault}"):
        read_json(path)
