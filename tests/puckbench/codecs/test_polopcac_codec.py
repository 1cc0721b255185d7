"""The codec `polopcac` calls its network and G-PCC's coder as its rates say."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from pcc_networks import polopcac
from pointkit.coding.byte_io import Reader, base_128
from pointkit.errors import InputError
from pointkit.geometry.cloud import PointCloud
from puckbench.codecs.base import Codec
from puckbench.codecs.coding import attribute_bytes
from puckbench.codecs.registry import codec_of, open_codec
from puckbench.geometry.attributes import attributes_of
from tests.support.codecs import decode_cloud, encode_cloud
from tests.support.learned_codecs import changes, save_tiny, sealed

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("polopcac")
    save_tiny("polopcac", path / "ckpt.pt")
    return path


@pytest.fixture(scope="module")
def codec(folder: Path) -> Codec:
    return open_codec("polopcac", {"options": {"weights": str(folder)}})


def _cloud(most: int = 255) -> PointCloud:
    random = np.random.default_rng(0)
    return PointCloud(
        random.integers(0, 200, (400, 3)) / 100,
        colours=random.integers(0, 256, (400, 3)).astype(np.uint8),
        fields={"intensity": random.integers(0, most + 1, 400)},
        about={"size": 0},
    )


def _rows(cloud: PointCloud) -> list[tuple[int, ...]]:
    values = attributes_of(cloud)
    columns = [values[name].reshape(len(cloud), -1) for name in sorted(values)]
    return sorted(map(tuple, np.column_stack([np.rint(cloud.xyz * 100), *columns]).tolist()))


@pytest.mark.parametrize("most", [127, 255, 65535])
def test_attributes_come_back_without_loss_and_positions_as_gpccs(codec: Codec, most: int) -> None:
    cloud = _cloud(most)
    stream = encode_cloud(codec, cloud, "2mm")
    assert codec_of(stream) == "polopcac"
    assert _rows(decode_cloud(codec, stream)) == _rows(cloud)
    sizes = attribute_bytes(codec, stream)
    assert sizes.keys() == {"reflectance", "colour"}
    gpcc = open_codec("gpcc", {"options": {"duplicates": "kept"}})
    bare = encode_cloud(gpcc, cloud, "2mm")
    assert len(stream) - sum(sizes.values()) == len(bare) + 9 + len(base_128(len(bare)))


def test_all_values_are_kept_on_a_grid_where_points_become_equal(codec: Codec) -> None:
    cloud = _cloud()
    decoded = decode_cloud(codec, encode_cloud(codec, cloud, "100mm"))
    assert len(decoded) == len(cloud) > len(np.unique(decoded.xyz, axis=0))
    for name, values in attributes_of(cloud).items():
        assert np.array_equal(
            np.sort(attributes_of(decoded)[name], axis=0), np.sort(values, axis=0)
        )


def test_the_library_and_the_codec_code_the_same_attributes(codec: Codec, folder: Path) -> None:
    cloud = _cloud()
    whole = PointCloud(
        cloud.xyz * 100, colours=cloud.colours, fields=cloud.fields, about={"size": 1024}
    )
    stream = encode_cloud(codec, whole, "r8")
    values = {"reflectance": cloud.fields["intensity"], "colour": cloud.colours}
    positions = np.rint(whole.xyz).astype(np.int64)
    expected = polopcac.encode(positions, values, polopcac.load_weights(folder / "ckpt.pt"))
    assert stream.endswith(expected)


def test_other_weights_are_named(codec: Codec, tmp_path: Path) -> None:
    stream = encode_cloud(codec, _cloud(), "2mm")
    save_tiny("polopcac", tmp_path / "ckpt.pt", seed=1)
    other = open_codec("polopcac", changes("polopcac", tmp_path))
    with pytest.raises(InputError, match="made with other weights"):
        decode_cloud(other, stream)


def test_damage_behind_a_check_sum_that_fits_ends_in_points_or_one_error(codec: Codec) -> None:
    stream = encode_cloud(codec, _cloud(), "2mm")
    random = np.random.default_rng(1)
    reader = Reader(stream[9:])
    start = 9 + len(reader.take(reader.number())) + 2  # of the attributes
    decoded = 0
    for trial in range(200):
        damaged = bytearray(stream if trial % 4 else stream[: random.integers(9, len(stream))])
        first = start if trial % 2 else 9
        for _ in range(random.integers(1, 4)):
            place = int(random.integers(min(first, len(damaged) - 1), len(damaged)))
            damaged[place] = random.integers(256)
        with suppress(InputError):
            assert np.isfinite(decode_cloud(codec, sealed(bytes(damaged), 5)).xyz).all()
            decoded += 1
    assert decoded < 50
