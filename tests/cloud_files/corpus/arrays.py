"""NumPy's files, and frames of bare float32."""

from __future__ import annotations

import io
import struct
import warnings
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.support.corpus_case import cloud_case as _case

TWO = np.array([(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)])


def _npy(array: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.asanyarray(array), allow_pickle=True)
    return stream.getvalue()


def _npz(**arrays: Any) -> bytes:
    stream = io.BytesIO()
    np.savez_compressed(stream, **{name: np.asanyarray(part) for name, part in arrays.items()})
    return stream.getvalue()


def _claimed(shape: str, data: bytes = bytes(24), kind: str = "'<f8'") -> bytes:
    """An NPY file, laid out by hand, whose header says a shape and a type."""
    text = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


def _bomb() -> bytes:
    """An archive of 0.3 MB whose array has 300 MB."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xyz.npy", _claimed("(12500000, 3)", bytes(300_000_000)))
    return stream.getvalue()


def _twice() -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive, warnings.catch_warnings(action="ignore"):
        archive.writestr("xyz.npy", _npy(TWO))
        archive.writestr("xyz.npy", _npy(TWO + 1))
    return stream.getvalue()


def _fields(*kinds: Any, **values: Any) -> NDArray[Any]:
    rows = np.zeros(2, dtype=list(kinds))
    for name, part in values.items():
        rows[name] = part
    return rows


_XYZ = [(axis, "<f4") for axis in "xyz"]
_NAMED = dict(zip("xyz", TWO.T, strict=True))


RNG = np.random.default_rng(8)
_AROUND = RNG.uniform(0, 2 * np.pi, 64)
_RANGES = np.round(RNG.uniform(2, 40, 64), 3)
SCAN = np.column_stack(
    [_RANGES * np.cos(_AROUND), _RANGES * np.sin(_AROUND), RNG.uniform(-2, 1, 64)]
).astype("<f4")
"""Points around a sensor."""
RINGS = np.arange(64) % 32
_INTENSITY = RNG.uniform(0, 1, 64).astype("<f4")
_TIMES = np.linspace(0, 0.1, 64).astype("<f4")
_BYTES = RNG.integers(0, 256, 64)


def _frame(*columns: Any) -> bytes:
    return np.column_stack(columns).astype("<f4").tobytes()


def _nuscenes() -> bytes:
    """All 32 firings of columns, of which some have no return; the car moves by 0.43 m."""
    left = np.linspace(1, 0, 40)[:, None, None]
    xyz = np.broadcast_to(left * np.array([0.1, -0.41, 0.02]), (40, 32, 3)).copy()
    azimuth = np.linspace(0, 6, 40)[:, None]
    far = 5.0 + np.arange(32.0)
    seen = (np.arange(40)[:, None] + np.arange(32)) % 3 > 0
    seen[7] = True
    seen[7, 5] = False  # the only firing of its column without a return
    points = np.stack(
        [far * np.cos(azimuth), far * np.sin(azimuth), np.broadcast_to(far / 9, seen.shape)], axis=2
    )
    xyz[seen] = points[seen]
    intensity = np.where(seen, 20, 0)
    rings = np.broadcast_to(np.arange(32), seen.shape)
    return _frame(xyz.reshape(-1, 3), intensity.ravel(), rings.ravel())


_SWEEP = np.frombuffer(_nuscenes(), "<f4").reshape(-1, 5)
_SEEN = _SWEEP[_SWEEP[:, 3] > 0]

CASES = [
    # Arrays
    _case("rows.npy", _npy(TWO)),
    _case("fortran.npy", _npy(np.asfortranarray(TWO))),
    _case("big_endian.npy", _npy(TWO.astype(">f4"))),
    _case("millimetres.npy", _npy(TWO.astype("<i4") * 1000), TWO * 1000),
    _case("half.npy", _npy(TWO.astype("<f2"))),
    _case("image.npy", _npy(np.arange(1.0, 13).reshape(2, 2, 3)), np.arange(1.0, 13).reshape(4, 3)),
    _case(
        "image_of_a_sensor.npy",
        _npy(np.array([[TWO[0], [np.nan] * 3], [TWO[1], [np.nan] * 3]])),
        warning="image_of_a_sensor.npy: 2 of 4 points are missing returns",
    ),
    _case(
        "named.npy",
        _npy(_fields(*_XYZ, ("ring", "u1"), ring=[7, 8], **_NAMED)),
        fields={"ring": [7, 8]},
    ),
    _case("named_image.npy", _npy(_fields(*_XYZ, **_NAMED).reshape(1, 2))),
    _case(
        "named_parts.npy",
        _npy(
            _fields(
                ("position", "<f4", (3,)),
                ("spins", "<i2", (2,)),
                position=TWO,
                spins=[[1, 2], [3, 4]],
            )
        ),
        fields={"spins_0": [1, 3], "spins_1": [2, 4]},
    ),
    _case(
        "nested.npy",
        _npy(_fields(*_XYZ, ("more", [("a", "<f4")]), **_NAMED)),
        warning="nested.npy: columns without numbers are left out: more",
    ),
    _case(
        "words_and_times.npy",
        _npy(_fields(*_XYZ, ("who", "U3"), ("when", "M8[s]"), ("i", "u1"), **_NAMED)),
        fields={"i": [0, 0]},
        warning="left out: who, when",
    ),
    _case(
        "same_part.npy",
        _npy(_fields(*_XYZ, ("d", "<f4", 2), ("d_0", "<f4"), **_NAMED, d=7, d_0=8)),
        fields={"d_0": [8, 8], "d_0_": [7, 7], "d_1": [7, 7]},
    ),
    _case(
        "twice_x.npy",
        _npy(_fields(("xyz", "<f4", 3), ("x", "<f4"))),
        error="two arrays or fields hold the column x",
    ),
    _case("six_shares.npy", _npy(np.hstack([TWO, TWO / 10])), fields={"column_4": [0.1, 0.4]}),
    _case(
        "one_value_each.npy",
        _npy(
            _fields(
                *[(axis, "<f4", (1,)) for axis in "xyz"],
                **{a: p[:, None] for a, p in _NAMED.items()},
            )
        ),
    ),
    _case(
        "far_away.npy",
        _npy((TWO + np.array([500_000, 5_400_000, 0])).astype("<f4")),
        (TWO + np.array([500_000, 5_400_000, 0])).astype("<f4"),
        warning="far_away.npy: coordinates in single precision, in steps of 0.5",
    ),
    # Archives
    _case(
        "archive.npz",
        _npz(points=TWO, intensity=[7, 8], pose=np.eye(4)),
        fields={"intensity": [7, 8]},
    ),
    _case(
        "axes.npz",
        _npz(pose=np.eye(4), x=TWO[:, 0], y=TWO[:, 1], z=TWO[:, 2], ring=[7, 8]),
        fields={"ring": [7, 8]},
    ),
    _case("points_twice.npz", _npz(xyz=TWO, points=TWO + 9), error="hold the column x"),
    _case(
        "colours_twice.npz", _npz(xyz=TWO, colors=[[1] * 3] * 2, rgb=[[9] * 3] * 2), error="hold"
    ),
    _case(
        "other_length.npz",
        _npz(xyz=TWO, intensity=[1, 2, 3], pose=np.eye(4)),
        warning="array intensity is left out: 3 values for 2 points",
    ),
    _case("words.npz", _npz(xyz=TWO, who=["a", "b"]), warning="left out: who"),
    _case("capitals.npz", _npz(XYZ=TWO, Normals=TWO)),
    _case(
        "objects_beside.npz",
        _npz(xyz=TWO, names=np.array([None, "a"], dtype=object)),
        warning="objects_beside.npz: array names is left out: an array of Python objects",
    ),
    # Refused
    _case("scalar.npy", _npy(3.0), error=r"expected points of shape \(n, 3\), got \(\)"),
    _case(
        "flat.npy", _npy([1.0, 2.0, 3.0]), error=r"expected points of shape \(n, 3\), got \(3,\)"
    ),
    _case("side.npy", _npy(np.zeros((3, 40))), error="40 columns: transpose it"),
    _case("picture.npy", _npy(np.zeros((4, 4, 3), "u1")), error=r"got \(4, 4, 3\)"),
    _case("complex.npy", _npy(TWO + 1j), error="not numbers, but an array of complex128"),
    _case("words.npy", _npy([["a", "b", "c"]]), error="not numbers, but an array of <U1"),
    _case("truths.npy", _npy(TWO > 2), error="not numbers, but an array of bool"),
    _case(
        "objects.npy",
        _npy(np.array([[1, 2, None]], dtype=object)),
        error="an array of Python objects, not of numbers",
    ),
    _case("empty.npy", _npy(np.zeros((0, 3))), error="the cloud is empty"),
    _case(
        "named_empty.npy", _npy(_fields(("p", "<f4", (2,)), *_XYZ)[:0]), error="the cloud is empty"
    ),
    _case(
        "claims_much.npy", _claimed("(1000000000000, 3)"), error="truncated: 24 bytes are too few"
    ),
    _case("claims_no_less.npy", _claimed("(-1, 3)"), error="truncated|not a readable NumPy array"),
    _case("claims_words.npy", _claimed("('a', 3)"), error="not a readable NumPy array"),
    _case("claims_kind.npy", _claimed("(1, 3)", kind="'<q9'"), error="not a readable NumPy array"),
    _case("claims_depth.npy", _claimed("(" * 900), error="not a readable NumPy array"),
    _case("cut.npy", _npy(TWO)[:-1], error="truncated: 47 bytes"),
    _case(
        "ragged.npz",
        _npz(x=[1.0, 2.0], y=[1.0], z=[1.0, 2.0]),
        error="x, y and z have different lengths",
    ),
    _case(
        "scalar_axis.npz",
        _npz(x=1.0, y=[1.0], z=[1.0]),
        error=r"array x: expected numbers of shape \(n,\)",
    ),
    _case("nothing.npz", _npz(a=TWO, b=TWO), error=r"no array of points \(its arrays: a, b\)"),
    _case("twice.npz", _twice(), error="two arrays of the archive have one name"),
    _case("bomb.npz", lambda path: path.write_bytes(_bomb()), error="unpacks to more than"),
    _case("cut.npz", _npz(xyz=TWO)[:-9], error="not a readable NumPy archive"),
    # Frames of bare float32: the values tell the columns, whatever the name
    _case("kitti.bin", _frame(SCAN, _INTENSITY), SCAN, fields={"intensity": _INTENSITY.tolist()}),
    _case("kitti_bytes.bin", _frame(SCAN, _BYTES), SCAN, fields={"intensity": _BYTES.tolist()}),
    _case("five.bin", _frame(SCAN, _BYTES, RINGS), SCAN, fields={"ring": RINGS.tolist()}),
    _case("timed.bin", _frame(SCAN, _INTENSITY, _TIMES), SCAN, fields={"time": _TIMES.tolist()}),
    _case(
        "six.bin",
        _frame(SCAN, _INTENSITY, RINGS, _TIMES),
        SCAN,
        fields={"ring": RINGS.tolist(), "time": _TIMES.tolist()},
    ),
    _case("three.bin", _frame(SCAN), SCAN),
    _case(
        "four.pcd.bin", _frame(SCAN, _INTENSITY), SCAN, fields={"intensity": _INTENSITY.tolist()}
    ),
    _case("one_point.bin", struct.pack("<4f", 1, 2, 3, 4), [(1, 2, 3)]),
    _case(
        "named.bin",
        _frame(_INTENSITY[:4], SCAN[:4], _BYTES[:4]),
        SCAN[:4],
        options={"bin_columns": "intensity,x,y,z,_"},
        fields={"intensity": _INTENSITY[:4].tolist()},
    ),
    _case("numbered.bin", _frame(TWO, [7, 8]), TWO, options={"bin_columns": "4"}),
    _case(
        "sweep.pcd.bin",
        _nuscenes(),
        _SEEN[:, :3],
        fields={"ring": _SEEN[:, 4].tolist()},
        warning=f"{len(_SWEEP) - len(_SEEN)} of 1280 points are missing returns",
    ),
    _case("sweep_kept.pcd.bin", _nuscenes(), _SWEEP[:, :3], options={"keep_missing": True}),
    _case(
        "zeros.bin",
        _frame(np.vstack([SCAN, np.zeros((34, 3))]), np.append(_INTENSITY, np.zeros(34))),
        SCAN,
        warning="zeros.bin: 34 of 98 points are missing returns",
    ),
    _case(
        "cut_five.bin",
        _frame(SCAN, _BYTES, RINGS)[:-4],
        error="truncated: 1276 bytes are not whole points of 20",
    ),
    _case(
        "seven.bin",
        _frame(SCAN, _INTENSITY, RINGS, _TIMES, _BYTES),
        error="may have 7 values each: .*--bin-columns",
    ),
    _case(
        "three_or_four.bin",
        RNG.uniform(1, 2, 48).astype("<f4").tobytes(),
        error="may have 3 or 4 values each: .*--bin-columns",
    ),
    _case(
        "three_or_four_few.bin",
        _frame(TWO[[0, 1, 0]], [1, 2, 3]),
        error="may have 3 or 4 or 6 values",
    ),
    _case(
        "integers.bin",
        (np.column_stack([SCAN, _INTENSITY]) * 1000).astype("<i4").tobytes(),
        error="no frame of a LiDAR",
    ),
    _case("doubles.bin", TWO.tobytes() * 8, error="no frame of a LiDAR|values each"),
    _case("empty.bin", b"", error="the cloud is empty"),
    _case(
        "odd_option.bin",
        _frame(TWO, [7, 8]),
        options={"bin_columns": "9"},
        error="bin_columns: 3 to 6, or different names",
    ),
    _case(
        "double_option.bin",
        _frame(TWO, [7, 8]),
        options={"bin_columns": "x,y,z,x"},
        error="bin_columns: 3 to 6, or different names",
    ),
    _case(
        "pointer.bin",
        b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n",
        error="a Git-LFS pointer, not the file itself: git lfs pull",
    ),
]
