"""The authors' weights, fetched from a server on this machine that stands in for the real one."""

import hashlib
import io
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from puckbench.cli import main
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.learned import PUBLISHED_WEIGHTS
from puckbench.codecs.registry import open_codec
from puckbench.codecs.weights_label import weights_label
from puckbench.scene_sets import published_files
from puckbench.scene_sets.sources import SOURCES
from tests.support.file_server import served_files
from tests.support.tensorflow_checkpoint import checkpoint

VARIABLES = {"b": np.arange(3.0), "c": np.ones((2, 2)), "a": np.zeros(1)}
RATES = {
    "pcgcv1": ("0.75", "2", "3.5", "6", "10"),
    "pcgcv2": ("025", "05", "1", "2", "4", "6", "10"),
}


RENO_SETS = ("KITTIDetection", "SemanticKITTI", "Ford")


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """Address and folder of a server on this machine."""
    with served_files(tmp_path / "served") as address:
        yield address, tmp_path / "served"


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@pytest.fixture
def known(server: tuple[str, Path], monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Stand-ins for all files with their hashes, served, and in the place of the real source."""
    host, folder = server
    served: dict[str, bytes] = {"LICENSE": b"Apache", "ckpt.index": b"", "ckpt.data": b""}
    served["ckpt.index"], served["ckpt.data"] = checkpoint(
        {**VARIABLES, "main_optimizer/beta1_power": np.ones(1)}
    )
    archive = io.BytesIO()
    values = {name: VARIABLES[name].astype(np.float32) for name in ("c", "a", "b")}
    np.savez(archive, **values)  # type: ignore[arg-type]
    sources, git = ["one/ckpt.index", "one/ckpt.data"], published_files._git_name
    files: dict[str, Any] = {
        "LICENSE-PCGCv1": {"from": ["one/LICENSE"], "sha256": _sha256(b"Apache")}
    }
    for rate in RATES["pcgcv1"]:
        files[f"a{rate}b3.npz"] = {"from": sources, "sha256": _sha256(archive.getvalue())}
    names = [git(served[name]) for name in ("ckpt.index", "ckpt.data")]
    files["a3.5b3.npz"] = {"from": sources, "git": names}
    for rate in RATES["pcgcv2"]:
        name = f"c8_a{rate}_32000.pth"
        served[name] = rate.encode()
        files[name] = {"from": [f"one/{name}"], "sha256": _sha256(rate.encode())}
    for name, content in served.items():
        (folder / name).write_bytes(content)
    result = {"repositories": {"one": "."}, "files": files, "order": "02 00 01"}
    download = partial(published_files.download, host=host, table=result)
    monkeypatch.setitem(
        SOURCES, "pcgc_weights", replace(SOURCES["pcgc_weights"], download=download)
    )
    return result


@pytest.mark.usefixtures("known")
def test_one_command_brings_the_published_codecs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in RATES:
        why = why_not_here(open_codec(name))
        assert why == f"no weights in {PUBLISHED_WEIGHTS}: fetch them (puckbench data pcgc_weights)"
    assert main(["data", "pcgc_weights"]) == 0
    assert "pcgc_weights" in capsys.readouterr().out
    for name, rates in RATES.items():
        codec = open_codec(name)
        assert not why_not_here(codec)
        assert len({*map(codec.weights, codec.rates)}) == len(rates)
    folder = Path(PUBLISHED_WEIGHTS)
    assert (folder / "LICENSE-PCGCv1").read_text() == "Apache"
    assert "MIT License" in (folder / "CREDITS.md").read_text()
    with np.load(folder / "a2b3.npz") as archive:
        assert archive.files == ["c", "a", "b"]
        np.testing.assert_array_equal(archive["c"], VARIABLES["c"])
    assert main(["data", "pcgc_weights"]) == 0
    assert "present" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("served", "content", "fault"),
    [
        ("c8_a1_32000.pth", b"other", r"c8_a1_32000\.pth has the SHA-256 .*, not the expected"),
        ("ckpt.index", b"other", r"a0\.75b3\.npz: not a TensorFlow checkpoint"),
        ("LICENSE", None, "LICENSE cannot be fetched "),
    ],
)
def test_what_is_not_the_known_file_leaves_nothing(
    known: dict[str, Any],
    server: tuple[str, Path],
    served: str,
    content: bytes | None,
    fault: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = server[1] / served
    path.unlink() if content is None else path.write_bytes(content)
    assert main(["data", "pcgc_weights", "--folder", str(tmp_path / "data")]) == 2
    assert len(printed := capsys.readouterr().err.splitlines()) == 1
    assert re.search(fault, printed[0])
    assert list((tmp_path / "data").iterdir()) == []


def test_a_checkpoint_without_a_known_hash_is_known_by_its_name_in_git(
    known: dict[str, Any], server: tuple[str, Path], tmp_path: Path
) -> None:
    known["files"] = {"a3.5b3.npz": known["files"]["a3.5b3.npz"]}
    assert published_files.download(tmp_path, server[0], known).is_file()
    (server[1] / "ckpt.data").write_bytes(bytes(100))
    with pytest.raises(published_files.InputError, match="differs from the published one"):
        published_files.download(tmp_path, server[0], known)


def test_the_weights_of_reno_come_alike(
    server: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = published_files.published("reno_weights")
    assert all(len(about["sha256"]) == 64 for about in table["files"].values())
    assert {Path(name).stem for name in table["files"]} == {*RENO_SETS, "LICENSE-RENO"}
    for about in table["files"].values():
        path = server[1] / about["from"][0].replace("reno/", "")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(path.parent.name.encode())
        about["sha256"] = _sha256(path.read_bytes())
    table["repositories"] = {"reno": "."}
    source = SOURCES["reno_weights"]
    assert isinstance(source.download, partial)
    download = partial(source.download, host=server[0], table=table)
    monkeypatch.setitem(SOURCES, "reno_weights", replace(source, download=download))
    monkeypatch.chdir(tmp_path)
    assert main(["data", "reno_weights"]) == 0
    assert not why_not_here(open_codec("reno"))
    assert "MIT License" in Path("data/reno_weights/CREDITS.md").read_text()
    for name in RENO_SETS:
        codec = open_codec("reno", {"options": {"trained_on": name}})
        assert weights_label(codec.weights("8mm")) == f"{name} {_sha256(name.encode())[:16]}"


def test_the_weights_of_lizip_have_a_commit_a_licence_and_hashes() -> None:
    table = published_files.published("lizip_weights")
    assert set(table["files"]) == {"LICENSE-LIZIP", "mlp_c3_h256.bin"}
    assert all(len(about["sha256"]) == 64 for about in table["files"].values())
    assert len(table["repositories"]["lizip"].split("/")[-1]) == 40
    assert "MIT License" in SOURCES["lizip_weights"].credits(Path())


def test_the_weights_of_polopcac_have_digests_and_a_licence() -> None:
    table = published_files.published("polopcac_weights")
    assert table["files"].keys() == {"ckpt.pt", "LICENSE-POLOPCAC"}
    assert all(len(about["sha256"]) == 64 for about in table["files"].values())
    assert "MIT License" in SOURCES["polopcac_weights"].credits(Path())


def test_recordings_of_ouster_sensors_have_metadata_digests_and_a_licence() -> None:
    table = published_files.published("ouster_recordings")
    assert all(len(about["sha256"]) == 64 for about in table["files"].values())
    names = {Path(name) for name in table["files"]}
    captures = {name for name in names if name.suffix == ".pcap"}
    assert len(captures) == 6
    whole = {name for name in captures if "_lb_n3" not in name.stem}
    described = {name.with_suffix(".json") for name in whole}
    digests = {name.with_name(f"{name.stem}_digest.json") for name in whole}
    rest = {Path("LICENSE-OUSTER-SDK"), Path("OS-1-128_v2.3.0_1024x10.json")}
    assert names == captures | described | digests | rest
    assert "BSD 3-Clause" in SOURCES["ouster_recordings"].credits(Path())


def test_the_real_table_has_every_rate_and_licence() -> None:
    files = published_files.published()["files"]
    expected = {f"a{rate}b3.npz" for rate in RATES["pcgcv1"]}
    expected |= {f"c8_a{rate}_32000.pth" for rate in RATES["pcgcv2"]}
    assert set(files) == expected | {"LICENSE-PCGCv1", "LICENSE-PCGCv2"}
    assert len(bytes.fromhex(published_files.published()["order"])) == 222
    assert {name for name, about in files.items() if "sha256" not in about} == {"a3.5b3.npz"}
    assert published_files._git_name(b"") == "e69de29bb2d1d6434b8b29ae775ad8c2e48c5391"
