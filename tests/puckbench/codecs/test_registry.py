import subprocess
import sys
from dataclasses import replace
from inspect import get_annotations
from pathlib import Path

import numpy as np
import pytest

from pointkit.errors import InputError
from pointkit.registry import load, trust
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import why_not_here
from puckbench.codecs.rates import metric_rates, parameters_of, scaled_rates
from puckbench.codecs.registry import Look, based_on, codec_class, codec_of, codecs, entry, look
from puckbench.library import open_codec
from puckbench.planning.costs import costs_of
from tests.support.codecs import decode, encode, encode_returns
from tests.support.returns import homemade

USER_CODEC = """
from puckbench.codecs.base import Codec, PointCloud
import numpy as np

class Raw(Codec):
    def encode(self, cloud, rate):
        return cloud.xyz.astype(self.rates[rate]["kind"]).tobytes()
    def decode(self, stream):
        return PointCloud(np.frombuffer(stream, "<f4").reshape(-1, 3).astype(float))
"""


def test_a_codec_of_ones_own_comes_from_a_file(tmp_path: Path) -> None:
    (tmp_path / "raw.py").write_text(USER_CODEC)
    changes = {"class": f"{tmp_path}/raw.py:Raw", "rates": {"r1": {"kind": "<f4"}}}
    codec = open_codec("raw", changes)
    points = np.array([[1.0, 2.0, 3.0]])
    assert decode(codec, encode(codec, points, "r1")).tolist() == points.tolist()


def test_a_class_of_ones_own_names_its_rates(tmp_path: Path) -> None:
    (tmp_path / "raw.py").write_text(
        USER_CODEC + '    rates = {"r1": {"kind": "<f4"}, "r2": {"kind": "<f8"}}'
    )
    changes = {"class": f"{tmp_path}/raw.py:Raw"}
    assert list(open_codec("raw", changes).rates) == ["r1", "r2"]
    assert list(open_codec("raw", {**changes, "rates": ["r2"]}).rates) == ["r2"]
    assert list(open_codec("raw", {**changes, "rates": {"r9": {}}}).rates) == ["r9"]
    (tmp_path / "bare.py").write_text(USER_CODEC)
    with pytest.raises(InputError, match="codec raw: neither its entry nor its class names rates"):
        open_codec("raw", {"class": f"{tmp_path}/bare.py:Raw"})


@pytest.mark.parametrize("name", ["gpcc", "gpcc_predictive", "gpcc_arena", "sparse_octree_net"])
def test_a_scale_that_is_missing_or_no_number_above_0_is_one_line(name: str) -> None:
    with pytest.raises(InputError, match=f"codec {name}: a rate lacks the parameter 'scale'"):
        open_codec(name, {"rates": {"r1": {"step": 2}}})
    for scale, fault in ((0, "division by zero"), ("much", "unsupported operand")):
        with pytest.raises(InputError, match=f"codec {name}: .*{fault}"):
            open_codec(name, {"rates": {"r1": {"scale": scale}}})


@pytest.mark.parametrize(
    ("name", "parameter"), [("draco", "quantization_bits"), ("pcgcv2_plus", "lmbda")]
)
def test_a_parameter_that_a_rate_lacks_is_one_line(name: str, parameter: str) -> None:
    codec = open_codec(name, {"rates": {"r1": {"step": 2}}})
    with pytest.raises(
        InputError, match=f"codec {name}: rate r1 lacks the parameter '{parameter}'"
    ):
        encode(codec, np.eye(3), "r1")


def test_an_empty_stream_is_refused(tmp_path: Path) -> None:
    (tmp_path / "raw.py").write_text(USER_CODEC.replace(".tobytes()", ".tobytes()[:0]"))
    changes = {"class": f"{tmp_path}/raw.py:Raw", "rates": {"r1": {"kind": "<f4"}}}
    with pytest.raises(InputError, match="codec raw: encode returned an empty stream"):
        encode(open_codec("raw", changes), np.eye(3), "r1")


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
    trust([place := f"{tmp_path}/one.py:One"])
    assert load(place, "test")().value == 1


def test_rates_are_chosen_in_the_tables_order() -> None:
    assert list(entry("draco", {"rates": ["r8", "r1"]})["rates"]) == ["r1", "r8"]


def test_a_length_is_a_rate_of_a_codec_whose_rates_are_steps() -> None:
    chosen = open_codec("gpcc", {"metric_rates": ["0.5mm", "2cm", "3mm", "1m"]})
    lengths = metric_rates(chosen.rates)
    assert list(lengths) == ["1000mm", "20mm", "3mm", "0.5mm"]  # by step, in millimetres
    assert [rate["step_m"] for rate in lengths.values()] == [1.0, 0.02, 0.003, 0.0005]
    both = open_codec("draco", {"rates": ["0.5mm", "r8", "30mm"]})
    assert list(both.rates) == ["r8", "30mm", "0.5mm"]
    assert list(open_codec("puck", {"rates": ["3.0mm"]}).rates) == ["3mm"]


@pytest.mark.parametrize(
    ("name", "rate", "fault"),
    [
        ("gpcc", "0mm", "rate '0mm': a length must be from 0.001mm to 100m"),
        ("gpcc", "-3mm", "rate '-3mm': a length must be"),
        ("gpcc", "7000m", "rate '7000m': a length must be"),
        ("gpcc", "1.2.3mm", "unknown rate '1.2.3mm'"),
        ("gpcc", "3km", "unknown rate '3km'"),
        ("gpcc_arena", "3mm", "unknown rate '3mm'"),  # rates of scaled clouds only
        ("gpcc_predictive", "3mm", "unknown rate '3mm'"),  # powers of two in other coordinates
        ("reno", "3mm", "unknown rate '3mm'"),  # those that its network is for
        ("packets_xz", "3mm", "unknown rate '3mm'"),  # lossless
        ("pcgcv2", "3mm", "unknown rate '3mm'"),
    ],
)
def test_a_length_that_a_codec_cannot_code_is_one_line(name: str, rate: str, fault: str) -> None:
    for key in ("metric_rates", "rates"):
        with pytest.raises(InputError, match=f"^codec {name}: {fault}"):
            open_codec(name, {key: [rate]})
    with pytest.raises(InputError, match=f"^codec {name}: {fault}"):
        parameters_of(open_codec(name), rate)


@pytest.mark.parametrize("name", ["gpcc", "draco", "cloudini", "laz", "sparse_octree_net"])
def test_points_are_coded_within_any_length(name: str) -> None:
    codec = open_codec(name)
    if why_not_here(codec):
        pytest.skip(why_not_here(codec))
    points = np.random.default_rng(2).random((300, 3)) * 4
    for rate, step in (("3mm", 0.003), ("0.7cm", 0.007), ("0.45mm", 0.00045)):
        decoded = decode(codec, encode(codec, points, rate))
        near = np.abs(decoded[:, None] - points).max(axis=2).min(axis=0)
        assert step / 8 < near.max() <= step / 2 * (1 + 1e-3) + 2e-7  # float32 of Draco


def test_pcc_arenas_draco_rates() -> None:
    bits = [rate["quantization_bits"] for rate in scaled_rates(codec_class("draco").rates).values()]
    assert bits == [4, 5, 6, 7, 8, 9, 10, 11]
    assert entry("draco")["options"] == {"compression_level": 10, "method": "kd_tree"}


@pytest.mark.parametrize(
    ("name", "changes", "fault"),
    [
        ("drako", {}, "unknown codec 'drako' \\(known: draco.*; did you mean 'draco'"),
        ("draco", {"rates": ["r9"]}, "unknown rate 'r9'"),
        (
            "draco",
            {"options": {"speed": 1}},
            r"unknown option 'speed' \(known: compression_",
        ),
        ("draco", {"options": {"compresion_level": 1}}, "did you mean 'compression_level'"),
        ("draco", {"options": {"compression_level": 11}}, "compression_level is 11, but must"),
        ("gpcc", {"options": {"profile": "fast"}}, "profile is 'fast', but must be .*'ctc'"),
        ("mine", {"class": "pathlib:Path"}, "not a class derived from Codec"),
        ("mine", {"class": "nothing"}, "unknown codec 'nothing'"),
        ("mine", {"class": "no.such.module:Thing"}, "cannot load"),
        ("mine", {"class": "puckbench.codecs.draco:Dracco"}, "cannot load"),
        ("mine", {"class": "missing.py:Thing"}, "cannot load"),
    ],
)
def test_faults_are_one_line(name: str, changes: dict[str, object], fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        open_codec(name, changes)


def test_a_foreign_stream_has_no_codec() -> None:
    with pytest.raises(InputError, match="no codec recognises"):
        codec_of(b"\x89PNG")


def test_every_codec_says_how_it_is_shown_and_recognised() -> None:
    for name, kind in codecs().items():
        shown = look(name)
        assert shown.title, name
        assert shown.colour, name
        assert shown.marker, name
        assert shown.rank < Look().rank, name
        assert kind.magic, name
        assert kind.rates, name


def test_a_changed_codec_has_another_name() -> None:
    changed = {name: base for name in codecs() if (base := based_on(open_codec(name)))}
    bases = {"pcgcv1_plus": "pcgcv1", "pcgcv2_plus": "pcgcv2", "pcgcv2_plus_rooms": "pcgcv2"}
    assert changed == bases
    for name, base in bases.items():
        assert look(name).title.startswith(f"{look(base).title}+")


def test_codecs_are_listed_and_opened_without_heavy_packages() -> None:
    program = (
        "import sys; from puckbench.codecs.registry import codecs, entry;"
        "[entry(name) for name in codecs()]; print(*sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    heavy = {"torch", "numba", "scipy", "DracoPy", "pandas", "matplotlib", "constriction"}
    assert heavy & set(done.stdout.split()) == set()


def test_the_memory_estimate_grows_with_the_points() -> None:
    for name in codecs():
        costs = costs_of(open_codec(name))
        assert costs.memory_of(2_000_000) > costs.memory_of(0) >= 400


def test_a_variant_is_its_codec_with_other_options_rates_and_looks() -> None:
    arena, gpcc = open_codec("gpcc_arena"), open_codec("gpcc")
    assert isinstance(arena, type(gpcc))
    assert arena.options.model_dump() == {
        **gpcc.options.model_dump(), "profile": "defaults", "rounding": "truncate"
    }  # fmt: skip
    assert look("gpcc_arena").title == "G-PCC (PCC Arena)"
    assert arena.rates == scaled_rates(gpcc.rates)
    assert entry("gpcc_arena")["class"] == "puckbench.codecs.gpcc:Gpcc"


def test_puck_by_key_turns_codes_every_turn_alone() -> None:
    """A second turn equal to the first costs Puck less."""
    turn = homemade().turns[0]
    sizes = {}
    for name in ("puck", "puck_key_turns"):
        codec = open_codec(name)
        for count in (1, 2):
            returns = replace(homemade(), turns=(turn,) * count)
            sizes[name, count] = len(encode_returns(codec, returns, "4mm"))
    assert sizes["puck", 1] == sizes["puck_key_turns", 1]
    assert sizes["puck", 2] < 0.95 * sizes["puck_key_turns", 2]


def test_a_configuration_has_variants_of_its_own() -> None:
    changes = {
        "class": "gpcc_arena",
        "title": "Coarse",
        "colour": "#123456",
        "options": {"rounding": "nearest"},
        "rates": ["r1"],
    }
    codec = open_codec("coarse", changes)
    shown = look("coarse", changes)
    assert (codec.name, shown.title, shown.colour, shown.marker) == (
        "coarse",
        "Coarse",
        "#123456",
        "X",
    )
    assert (codec.options.profile, codec.options.rounding) == ("defaults", "nearest")
    assert open_codec("other", entry("coarse", changes)).options.model_dump() == dict(codec.options)


def test_a_typing_error_in_a_variants_name_is_told() -> None:
    with pytest.raises(InputError, match="did you mean 'gpcc_arena'"):
        open_codec("gpcc_arna")


def test_a_codec_is_small() -> None:
    """More functions are around a codec, in coding.py, rates.py and registry.py."""
    kinds = Codec.__mro__[:-1]
    members = {name for kind in kinds for name in (*vars(kind), *get_annotations(kind))}
    names = {*members, *vars(open_codec("gpcc_lossless"))} - {"grid"}  # of codecs on a grid
    assert len({name for name in names if not name.startswith("_")}) <= 16
    hooks = {name for name in members if name.startswith("_") and not name.startswith("__")}
    assert hooks == {"_abc_impl"}
