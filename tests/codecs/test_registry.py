from pathlib import Path

import numpy as np
import pytest

from puckbench.codecs.registry import codec_of, entries, entry, installed, open_codec
from puckbench.core.errors import InputError
from puckbench.core.plugins import load_class

OWN = """
from puckbench.codecs.base import Codec
import numpy as np

class Raw(Codec):
    def _encode(self, points, parameters):
        return points.astype(parameters["kind"]).tobytes()
    def _decode(self, stream):
        return np.frombuffer(stream, "<f4").reshape(-1, 3).astype(float)
"""


def test_a_codec_of_ones_own_comes_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "raw.py").write_text(OWN)
    changes = {"class": f"{tmp_path}/raw.py:Raw", "rates": {"r1": {"kind": "<f4"}}}
    codec = open_codec("raw", changes)
    points = np.array([[1.0, 2.0, 3.0]])
    assert codec.decode(codec.encode(points, "r1")).tolist() == points.tolist()


def test_a_class_of_ones_own_names_its_rates(tmp_path: Path) -> None:
    (tmp_path / "raw.py").write_text(
        OWN + '    rates = {"r1": {"kind": "<f4"}, "r2": {"kind": "<f8"}}'
    )
    own = {"class": f"{tmp_path}/raw.py:Raw"}
    assert list(open_codec("raw", own).rates) == ["r1", "r2"]
    assert list(open_codec("raw", {**own, "rates": ["r2"]}).rates) == ["r2"]
    assert list(open_codec("raw", {**own, "rates": {"r9": {}}}).rates) == ["r9"]
    (tmp_path / "bare.py").write_text(OWN)
    with pytest.raises(InputError, match="codec raw: neither its entry nor its class names rates"):
        open_codec("raw", {"class": f"{tmp_path}/bare.py:Raw"})


def test_an_installed_package_brings_a_codec(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    about = tmp_path / "raw-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: raw\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[puckbench.codecs]\nraw = raw_points:Raw\n")
    (tmp_path / "raw_points.py").write_text(OWN + '    rates = {"r1": {"kind": "<f4"}}')
    monkeypatch.syspath_prepend(tmp_path)
    assert installed() == {"raw": "raw_points:Raw"}
    assert entry("raw")["rates"] == {"r1": {"kind": "<f4"}}
    with pytest.raises(InputError, match=r"unknown codec 'rar'.*, raw\)"):
        entry("rar")


def test_a_data_class_in_a_file_may_postpone_its_annotations(tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text(
        "from __future__ import annotations\n"
        "from dataclasses import dataclass\n"
        "from typing import ClassVar\n"
        "@dataclass\n"
        "class One:\n"
        "    kind: ClassVar[str] = 'a'\n"
        "    value: int = 1\n"
    )
    assert load_class(f"{tmp_path}/one.py:One", "test")().value == 1


def test_rates_are_chosen_in_the_tables_order() -> None:
    assert list(entry("draco", {"rates": ["r8", "r1"]})["rates"]) == ["r1", "r8"]


def test_pcc_arenas_draco_rates() -> None:
    bits = [rate["quantization_bits"] for rate in entries()["draco"]["rates"].values()]
    assert bits == [4, 5, 6, 7, 8, 9, 10, 11]
    assert entries()["draco"]["options"] == {"compression_level": 10}


@pytest.mark.parametrize(
    ("name", "changes", "fault"),
    [
        ("drako", {}, "unknown codec 'drako' \\(known: draco"),
        ("draco", {"rates": ["r9"]}, "unknown rate 'r9'"),
        ("draco", {"options": {"speed": 1}}, "speed"),
        ("mine", {"class": "nothing"}, "not of the form"),
        ("mine", {"class": "no.such.module:Thing"}, "cannot load"),
        ("mine", {"class": "puckbench.codecs.draco:Dracco"}, "cannot load"),
        ("mine", {"class": "missing.py:Thing"}, "cannot load"),
    ],
)
def test_faults_are_one_line(name: str, changes: dict[str, object], fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        open_codec(name, changes)


def test_a_foreign_stream_has_no_codec() -> None:
    with pytest.raises(InputError, match="no shipped codec"):
        codec_of(b"\x89PNG")
