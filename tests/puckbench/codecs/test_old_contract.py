"""Codecs of the contract before `encode` took clouds still run, and say what to rename."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.base import CloudKind, Codec
from puckbench.codecs.coding import (
    attribute_bytes,
    decoded,
    decoded_surfaces,
    encoded,
    why_not_here,
)
from puckbench.codecs.registry import codes_surfaces
from puckbench.library import open_codec
from puckbench.planning.costs import costs_of
from tests.support.returns import recorded

POINTS = np.arange(33.0).reshape(11, 3)
SCALED, METRIC = {"size": 1024}, {"size": 0}
OLD = """
import numpy as np
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from pointkit.geometry.mesh import Mesh
from puckbench.codecs.base import Availability, Codec, Cost, Memory, Pace, lengths


class Old(Codec):
    title = "Old"
    rates = {"r1": {"kind": "<f4"}, "r2": {"kind": "<f8"}}
    metric_rates = lengths(10, 1)
    memory = Memory(1234, 5)
    pace = Pace(1.0, 2.0)
    magic = b"OLD"

    def available(self):
        return Availability(not self.name.startswith("not"), "no licence")

    def check_frame(self, frame, rate=None):
        super().check_frame(frame, rate)
        if frame is None and rate == "r1":
            raise InputError(f"codec {self.name}: needs a frame")

    def _encode(self, points, parameters):
        return b"OLD" + points.astype(parameters.get("kind", "<f8")).tobytes()

    def _decode(self, stream):
        kind = "<f8" if len(stream) % 24 == 3 else "<f4"
        return np.frombuffer(stream[3:], kind).reshape(-1, 3).astype(float)


class OnAGrid(Old):
    grid = 1.0


class Narrow(Old):
    most_steps = 100.0
    any_length = False

    def shared_work(self):
        return Shared()

    def _encode_sharing(self, points, parameters, shared):
        shared.used = True
        return self._encode(points, parameters)


class Shared:
    used = False
    saved = Cost(0.0, 0.0)


class Attributed(Old):
    attributes = ("reflectance",)

    def _encode_with_attributes(self, points, attributes, parameters):
        return attributes["reflectance"].astype("<u2").tobytes() + self._encode(points, parameters)

    def _decode_with_attributes(self, stream):
        start = stream.index(b"OLD")
        values = np.frombuffer(stream[:start], "<u2")
        fields = {"reflectance": values} if start else {}
        return PointCloud(self._decode(stream[start:]), fields=fields)

    def _attribute_bytes(self, stream):
        return {"reflectance": stream.index(b"OLD")}


class Sensing(Codec):
    metric_rates = lengths(2)
    takes = "returns"

    def _encode(self, points, parameters):
        raise InputError("codes returns")

    def _decode(self, stream):
        raise NotImplementedError

    def _encode_returns(self, returns, parameters):
        import puck

        return puck.encode_returns(returns, puck.CodingOptions(1))

    def _decode_returns(self, stream):
        import puck

        return puck.decode_returns(stream)


class Surfaces(Old):
    surfaces = True

    def _decode_mesh(self, stream):
        return Mesh(self._decode(stream), np.array([[0, 1, 2]]))


class Unnamed(Old):
    metric_rates = {"fine": {"step": 1}}


class New(Codec):
    rates = {"r1": {}}

    def encode(self, cloud, rate):
        return self._encode(cloud.xyz)

    def decode(self, stream):
        return PointCloud(np.frombuffer(stream).reshape(-1, 3))

    def _encode(self, points):
        return points.tobytes()
"""
DERIVED = """
from puckbench.codecs.gpcc import Gpcc


class Mine(Gpcc):
    def _encode(self, points, parameters):
        return b"mine"
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("old") / "old_codecs.py"
    path.write_text(OLD)
    return path


def _opened(file: Path, name: str) -> Codec:
    return open_codec(name.lower(), {"class": f"{file}:{name}"})


def test_an_old_codec_runs_and_says_once_what_to_rename(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    codec = _opened(file, "Old")
    _opened(file, "Old")
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("puckbench: codec Old has an old interface: _encode is now encode(cloud")
    assert "metric_rates is now rates" in line
    assert list(codec.rates) == ["r1", "r2", "10mm", "1mm"]
    for rate, about in (("r1", SCALED), ("r2", SCALED), ("10mm", METRIC), ("3mm", METRIC)):
        cloud = PointCloud(POINTS, about=about)
        assert np.array_equal(decoded(codec, encoded(codec, cloud, rate)).xyz, POINTS)
    far = PointCloud(POINTS + 1e9, about=METRIC)
    assert np.array_equal(decoded(codec, encoded(codec, far, "1mm")).xyz, far.xyz)
    assert costs_of(codec).memory_of(1_000_000) == 1239
    assert costs_of(codec).seconds_of(1_000_000) == 3.0


def test_what_an_old_codec_refuses_it_skips(file: Path) -> None:
    codec = _opened(file, "Old")
    assert codec.skip(CloudKind(None), "r1") == "needs a frame"
    assert codec.skip(CloudKind("scaled"), "r1") is None
    fault = codec.skip(CloudKind("scaled"), "10mm")
    assert fault is not None
    assert "are lengths, and the cloud is scaled" in fault
    fault = _opened(file, "OnAGrid").skip(CloudKind("metric"), "r2")
    assert str(fault).startswith("its rates are steps of a scaled cloud's grid")
    lacking = open_codec("not_here", {"class": f"{file}:Old"})
    assert why_not_here(lacking) == "no licence"
    narrow = _opened(file, "Narrow")
    assert narrow.skip(CloudKind("metric", extent_m=0.9), "10mm") is None
    assert "more than 1 m" in str(narrow.skip(CloudKind("metric", extent_m=1.1), "10mm"))
    with pytest.raises(InputError, match="unknown rate '3mm'"):
        encoded(narrow, PointCloud(POINTS, about=METRIC), "3mm")


def test_old_shared_work_is_prepared(file: Path) -> None:
    codec, cloud = _opened(file, "Narrow"), PointCloud(POINTS, about=SCALED)
    work = codec.prepare(cloud)
    assert encoded(codec, cloud, "r1", work) == encoded(codec, cloud, "r1")
    assert vars(work)["used"]


def test_old_attributes_come_back(file: Path) -> None:
    codec = _opened(file, "Attributed")
    cloud = PointCloud(POINTS, fields={"intensity": np.arange(11)}, about=SCALED)
    stream = encoded(codec, cloud, "r2")
    assert decoded(codec, stream).fields["reflectance"].tolist() == list(range(11))
    assert attribute_bytes(codec, stream) == {"reflectance": 22}
    bare = encoded(codec, PointCloud(POINTS, about=SCALED), "r2")
    assert attribute_bytes(codec, bare) == decoded(codec, bare).fields == {}


def test_an_old_codec_of_returns_takes_them(file: Path) -> None:
    codec, returns = _opened(file, "Sensing"), recorded(60)
    cloud = PointCloud(returns.points(), about=METRIC, returns=returns)
    back = decoded(codec, encoded(codec, cloud, "2mm")).returns
    assert back is not None
    np.testing.assert_array_equal(back.turns[0].ranges, returns.turns[0].ranges)
    with pytest.raises(InputError, match="codes the returns of a spinning sensor"):
        encoded(codec, PointCloud(POINTS, about=METRIC), "2mm")


def test_an_old_codec_of_surfaces_decodes_them(file: Path) -> None:
    codec = _opened(file, "Surfaces")
    stream = encoded(codec, PointCloud(POINTS, about=SCALED), "r2")
    assert np.array_equal(decoded_surfaces(codec, stream).vertices, POINTS)
    places = {name: {"class": f"{file}:{name}"} for name in ("Surfaces", "Old")}
    assert [codes_surfaces("mine", place) for place in places.values()] == [True, False]


def test_a_new_codec_may_have_a_method_of_an_old_name(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    codec, cloud = _opened(file, "New"), PointCloud(POINTS, about=SCALED)
    assert np.array_equal(decoded(codec, encoded(codec, cloud, "r1")).xyz, POINTS)
    assert capsys.readouterr().err == ""


def test_what_no_adapter_can_do_is_one_line(file: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="metric_rates: 'fine' is no length"):
        _opened(file, "Unnamed")
    (tmp_path / "derived.py").write_text(DERIVED)
    fault = "Mine defines _encode, which its base class no longer calls: define encode and decode"
    with pytest.raises(InputError, match=fault):
        _opened(tmp_path / "derived.py", "Mine")
