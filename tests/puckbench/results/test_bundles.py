"""Bundles that were changed, or made to do harm, are refused in one line."""

from __future__ import annotations

import json
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pointkit.errors import InputError
from puckbench.cli import main
from puckbench.core.archives import read_archive, write_archive
from puckbench.results.bundles import (
    FORMAT,
    MANIFEST,
    Bundle,
    FileDigest,
    Manifest,
    digests_in,
    read_bundle,
    sha256_of,
    write_bundle,
)

MEMBERS = {
    "configuration.yaml": b"results: results\n",
    "codecs/grid.py": b"class Grid: ...\n",
    "results/tables/metrics.csv": b"cloud,bpp\na,1.5\n",
    "results/tables/columns/metrics.csv": b"column\nbpp\n",
}


def manifest(**more: Any) -> Manifest:
    about = {
        "format": FORMAT,
        "versions": {"puckbench": "1.0"},
        "results": "results",
        "plugins": ("codecs/grid.py",),
        "files": {},
        "inputs": {"clouds/a.xyz": FileDigest(sha256="0" * 64, bytes=3)},
    }
    return Manifest(**{**about, **more})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_bundle(tmp_path / "a.zip", manifest(), MEMBERS)
    return tmp_path / "a.zip"


def refused(file: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """The line by which the file is refused."""
    assert main(["verify", str(file)]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.count("\n") == 1
    assert str(file) in shown.err
    return shown.err


def test_what_was_written_is_read(file: Path, tmp_path: Path) -> None:
    bundle = read_bundle(file)
    assert isinstance(bundle, Bundle)
    assert bundle.members == MEMBERS
    assert bundle.tables == {"metrics": MEMBERS["results/tables/metrics.csv"]}
    assert bundle.manifest.files == {name: sha256_of(data) for name, data in MEMBERS.items()}
    backwards = dict(reversed(MEMBERS.items()))
    write_bundle(tmp_path / "b.zip", manifest(), backwards)
    assert (tmp_path / "b.zip").read_bytes() == file.read_bytes()


def test_a_flipped_byte_in_any_member_is_found(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = file.read_bytes()
    with zipfile.ZipFile(file) as archive:
        places = {each.filename: (each.header_offset, each.file_size) for each in archive.filelist}
    assert places.keys() == {MANIFEST, *MEMBERS}
    for name, (offset, size) in places.items():
        content = offset + 30 + len(name)
        for at in (content, content + size // 2, content + size - 1):
            changed = bytearray(data)
            changed[at] ^= 1
            (tmp_path / "flipped.zip").write_bytes(changed)
            refused(tmp_path / "flipped.zip", capsys)


@pytest.mark.parametrize("name", MEMBERS)
def test_a_member_that_was_exchanged_added_or_removed_is_named(
    name: str, file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    members, other = read_archive(file), tmp_path / "other.zip"
    write_archive(other, {**members, name: members[name] + b" "})
    assert f"{name} was changed" in refused(other, capsys)
    write_archive(other, {n: data for n, data in members.items() if n != name})
    assert f"without {name}" in refused(other, capsys)
    write_archive(other, {**members, "more.py": b""})
    assert "'more.py' is not in the manifest" in refused(other, capsys)


@pytest.mark.parametrize(
    "name",
    [
        *("/etc/passwd", "../up.py", "a/../../up.py", "a//b", "a/", "./a", "", "C:/a", "a\\b"),
        *("a\nb", "\x1b[31m", "codecs/grid.py/inner", "a" * 2000),
    ],
)
def test_names_that_leave_the_folder_are_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    members = {**MEMBERS, name: b"x"}
    about = manifest().model_dump(mode="json")
    about["files"] = {n: sha256_of(data) for n, data in members.items()}
    write_archive(tmp_path / "a.zip", {MANIFEST: json.dumps(about).encode(), **members})
    refused(tmp_path / "a.zip", capsys)
    about["files"] = {n: sha256_of(data) for n, data in MEMBERS.items()}
    about["inputs"][name] = {"sha256": "0" * 64, "bytes": 1}
    write_archive(tmp_path / "a.zip", {MANIFEST: json.dumps(about).encode(), **MEMBERS})
    refused(tmp_path / "a.zip", capsys)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("format", 2),
        ("format", "1"),
        ("results", "/out"),
        ("results", "../out"),
        ("versions", {"numpy": "1\x1b[2J"}),
        ("machine", {"Processor": 3}),
        ("inputs", {"a": {"sha256": "zz", "bytes": 1}}),
        ("inputs", {"a": {"sha256": "0" * 64, "bytes": -1}}),
        ("streams", {"../a": {}}),
        ("plugins", "all"),
        ("files", None),
    ],
)
def test_a_manifest_with_other_values_is_refused(
    key: str, value: Any, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    members = read_archive(file)
    about = {**json.loads(members[MANIFEST]), key: value}
    write_archive(file, {**members, MANIFEST: json.dumps(about).encode()})
    assert key in refused(file, capsys)


def _compressed(archive: zipfile.ZipFile) -> None:
    archive.writestr("bomb", b"0" * 10**7, zipfile.ZIP_DEFLATED)


def _link(archive: zipfile.ZipFile) -> None:
    member = zipfile.ZipInfo("link")
    member.external_attr = (stat.S_IFLNK | 0o777) << 16
    archive.writestr(member, "/etc/passwd")


def _twice(archive: zipfile.ZipFile) -> None:
    archive.writestr("codecs/grid.py", "import os")


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("add", [_compressed, _link, _twice], ids=lambda f: f.__name__)
def test_bombs_links_and_repeated_names_are_refused(
    add: Callable[[zipfile.ZipFile], None], file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with zipfile.ZipFile(file, "a") as archive:
        add(archive)
    assert "archive" in refused(file, capsys)


@pytest.mark.parametrize("data", [b"", b"PK", b"no zip at all"])
def test_other_files_are_refused(
    data: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.zip").write_bytes(data)
    refused(tmp_path / "a.zip", capsys)
    write_archive(tmp_path / "a.zip", {"r1.bin": data})
    assert f"without {MANIFEST}" in refused(tmp_path / "a.zip", capsys)
    refused(tmp_path / "missing.zip", capsys)


def test_streams_that_are_not_those_of_the_manifest_are_refused(tmp_path: Path) -> None:
    name = "coded/mine/a/grid"
    write_archive(tmp_path / f"{name}.zip", {"r1.bin": b"abc", "r1.json": b"{}"})
    digests = digests_in(tmp_path, [name, "coded/mine/b/grid"])
    assert digests == {name: {"r1.bin": sha256_of(b"abc")}}
    members = {**MEMBERS, f"results/{name}.zip": (tmp_path / f"{name}.zip").read_bytes()}
    write_bundle(tmp_path / "a.zip", manifest(streams=digests), members)
    assert read_bundle(tmp_path / "a.zip").manifest.streams == digests
    other = {name: {"r1.bin": sha256_of(b"abd")}}
    write_bundle(tmp_path / "a.zip", manifest(streams=other), members)
    with pytest.raises(InputError, match=f"the streams of {name} are not those"):
        read_bundle(tmp_path / "a.zip")


def test_a_bundle_is_checked_without_running_its_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = b"from pathlib import Path\nPath('ran').touch()\n"
    write_bundle(tmp_path / "a.zip", manifest(), {**MEMBERS, "codecs/grid.py": code})
    monkeypatch.chdir(tmp_path)
    assert main(["verify", "a.zip"]) == 0
    assert "codecs/grid.py" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


def test_a_name_that_others_could_not_read_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'a\\\\nb' is not a path inside a folder"):
        write_bundle(tmp_path / "a.zip", manifest(), {**MEMBERS, "a\nb": b""})
    assert not list(tmp_path.iterdir())
