"""Files whose counts, lengths, places and numbers are at their limits, with sums that fit.

Each format has a function that finds its fields in a whole file, or lays the file out anew. The
same number makes the same file.
"""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from pointkit.seeding import generator
from tests.support.stream_damage import limit

Random = np.random.Generator
Field = tuple[int, str]
"""Place and layout of a number in a file."""
_BITS = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32, "q": 64, "Q": 64}
_FLOATS = (0.0, -0.0, 1e-320, 1e38, 1e308, -1e308, float("inf"), float("nan"), 1e-30)
_WORDS = ("0", "-1", "1", "nan", "1e999", "255", "65536", "2147483648", "4294967295")
_LARGE = ("9" * 19, "1" + "0" * 30, "-" + "9" * 19, "0.0000001", "1_000", "0x10", "", "x", "1 2")
_PAGE, _CHECK = 1024, 4


def structured_file(suffix: str, whole: Sequence[bytes], number: int) -> bytes:
    """One structured file of a format, of which `whole` has whole ones."""
    random = generator(number, f"structured files {suffix}")
    data = whole[random.integers(len(whole))]
    return WRITERS[suffix](data, random)


def _overwritten(data: bytes, fields: Sequence[Field], random: Random) -> bytes:
    """One to three fields hold numbers at their limits."""
    changed = bytearray(data)
    for _ in range(int(random.integers(1, 4)) if fields else 0):
        at, layout = fields[random.integers(len(fields))]
        struct.pack_into(layout, changed, at, _value(layout[-1], random))
    return bytes(changed)


def _value(kind: str, random: Random) -> float:
    if kind in "fd":
        value = _FLOATS[random.integers(len(_FLOATS))]
        return value if kind == "d" or not 3e38 < abs(value) < float("inf") else 3e38
    bits = _BITS[kind]
    value = limit(random, bits)
    return value - (1 << bits) if kind.islower() and value >= 1 << (bits - 1) else value


def _by(find: Callable[[bytes], Iterator[Field]]) -> Callable[[bytes, Random], bytes]:
    """A writer that overwrites the fields of a whole file."""

    def write(data: bytes, random: Random) -> bytes:
        fields = [item for item in find(data) if item[0] + struct.calcsize(item[1]) <= len(data)]
        return _overwritten(data, fields, random)

    return write


def _at(data: bytes, at: int, layout: str) -> int:
    """A number in a file, 0 past its end."""
    end = at + struct.calcsize(layout)
    return int(struct.unpack(layout, data[at:end])[0]) if end <= len(data) else 0


def text(data: bytes, random: Random) -> bytes:
    """Some words are numbers at their limits, or a line is there often, elsewhere, or not."""
    words = list(re.finditer(rb"[^\s,;:\[\]{}\"/]+", data))
    for _ in range(int(random.integers(1, 4)) if words else 0):
        spot = words[random.integers(len(words))]
        choices = (_WORDS, _LARGE)[random.integers(2)]
        new = choices[random.integers(len(choices))].encode()
        data = data[: spot.start()] + new + data[spot.end() :]
        words = list(re.finditer(rb"[^\s,;:\[\]{}\"/]+", data))
    if random.random() < 0.3:
        lines = data.split(b"\n")
        line = lines.pop(int(random.integers(len(lines))))
        for _ in range((0, 1, 2, 1000)[random.integers(4)]):
            lines.insert(int(random.integers(len(lines) + 1)), line)
        data = b"\n".join(lines)
    return data


def header(end: bytes) -> Callable[[bytes, Random], bytes]:
    """A writer for a text before bytes: the text is structured, or the numbers after it."""

    def write(data: bytes, random: Random) -> bytes:
        place = data.find(end)
        place = data.find(b"\n", place) + 1 if place >= 0 else 0
        body = data[place:]
        if random.random() < 0.3:
            fields = [(at, "<I") for at in range(min(len(body), 64) - 3)]
            return data[:place] + _overwritten(body, fields, random)
        return text(data[:place], random) + body

    return write


def _las(data: bytes) -> Iterator[Field]:
    yield from ((24, "<B"), (25, "<B"), (94, "<H"), (96, "<I"), (100, "<I"), (104, "<B"))
    yield from ((105, "<H"), (107, "<I"), (227, "<Q"), (235, "<Q"), (243, "<I"), (247, "<Q"))
    yield from ((at, "<d") for at in range(131, 179, 8))
    at, begin = _at(data, 94, "<H"), _at(data, 96, "<I")
    while at + 54 <= begin:
        yield from ((at + 18, "<H"), (at + 20, "<H"))
        if data[at + 2 : at + 18].startswith(b"laszip"):
            yield from ((at + 54, "<H"), (at + 56, "<H"), (at + 62, "<I"), (at + 66, "<I"))
            yield from ((at + 70, "<q"), (at + 78, "<q"), (at + 86, "<H"))
            yield from ((at + 88 + k, "<H") for k in range(0, 18, 2))
        else:
            yield from ((at + 54 + k, "<H") for k in range(0, _at(data, at + 20, "<H"), 2))
        at += 54 + _at(data, at + 20, "<H")
    table = _at(data, begin, "<q")
    yield from ((begin, "<q"), (table, "<I"), (table + 4, "<I"), (begin + 8, "<I"))
    yield from ((begin + 8 + k, "<B") for k in range(40))


def _e57(data: bytes, random: Random) -> bytes:
    """Fields of the header and of the binary sections, or numbers of the XML, with fitting sums."""
    pages = [data[at : at + _PAGE - _CHECK] for at in range(0, len(data), _PAGE)]
    logical = b"".join(pages)
    place, length = _at(data, 24, "<Q"), _at(data, 32, "<Q")
    place -= place // _PAGE * _CHECK
    head, xml = logical[:place], logical[place : place + length]
    if random.random() < 0.6:
        xml = text(xml, random)
        head = head[:32] + struct.pack("<Q", len(xml)) + head[40:]
    else:
        fields = [(8, "<I"), (12, "<I"), (16, "<Q"), (24, "<Q"), (32, "<Q"), (40, "<Q")]
        fields += [(at, "<H") for at in range(48, min(place, 160) - 1, 2)]
        fields += [(at, "<Q") for at in range(48, min(place, 96) - 7, 8)]
        head = _overwritten(head, fields, random)
    logical = head + xml
    logical += b" " * (-len(logical) % (_PAGE - _CHECK))
    count = len(logical) // (_PAGE - _CHECK)
    if random.random() < 0.9:
        logical = logical[:16] + struct.pack("<Q", count * _PAGE) + logical[24:]
    parts = [logical[at : at + _PAGE - _CHECK] for at in range(0, len(logical), _PAGE - _CHECK)]
    return b"".join(part + struct.pack(">I", crc32c(part)) for part in parts)


def _crc_table() -> list[int]:
    table = []
    for value in range(256):
        for _ in range(8):
            value = value >> 1 ^ (0x82F63B78 if value & 1 else 0)  # noqa: PLW2901
        table.append(value)
    return table


_CRC = _crc_table()


def crc32c(data: bytes) -> int:
    """The cyclic redundancy check of Castagnoli, as E57 has it after each page."""
    value = 0xFFFFFFFF
    for byte in data:
        value = value >> 8 ^ _CRC[(value ^ byte) & 0xFF]
    return value ^ 0xFFFFFFFF


def _npy(data: bytes, random: Random) -> bytes:
    """The dictionary of the header, its length, or values."""
    length = _at(data, 8, "<H")
    if random.random() < 0.2:
        return _overwritten(data, [(6, "<B"), (7, "<B"), (8, "<H")], random)
    if random.random() < 0.3:
        values = [(at, "<d") for at in range(10 + length, min(len(data), 200 + length) - 7)]
        return _overwritten(data, values, random)
    kinds = (b"'|O'", b"'<f16'", b"'<U9'", b"'<c16'", b"'>f2'", b"'<M8[ns]'", b"[('x', '<f8')]")
    head = re.sub(rb"\d+", lambda _: str(limit(random, 63)).encode(), data[10 : 10 + length])
    head = data[10 : 10 + length] if random.random() < 0.3 else head
    if random.random() < 0.3:
        head = re.sub(rb"'[<>|]\w+'", lambda _: kinds[random.integers(len(kinds))], head)
    head = head.rstrip()
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    return data[:8] + struct.pack("<H", len(head)) + head + data[10 + length :]


def _npz(data: bytes, random: Random) -> bytes:
    """Arrays with structured headers, or fields of the archive."""
    if random.random() < 0.4:
        return _by(_zip)(data, random)
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as source, zipfile.ZipFile(out, "w") as archive:
        for name in source.namelist():
            array = source.read(name)
            archive.writestr(name, _npy(array, random) if random.random() < 0.5 else array)
    return out.getvalue()


def _zip(data: bytes) -> Iterator[Field]:
    for start in (result.start() for result in re.finditer(rb"PK\x03\x04", data)):
        yield from ((start + 6, "<H"), (start + 8, "<H"), (start + 14, "<I"))
        yield from ((start + 18, "<I"), (start + 22, "<I"), (start + 26, "<H"), (start + 28, "<H"))
    for start in (result.start() for result in re.finditer(rb"PK\x01\x02", data)):
        yield from ((start + 8, "<H"), (start + 10, "<H"), (start + 20, "<I"), (start + 24, "<I"))
        yield from ((start + 28, "<H"), (start + 30, "<H"), (start + 42, "<I"))
    end = data.rfind(b"PK\x05\x06")
    yield from ((end + 8, "<H"), (end + 10, "<H"), (end + 12, "<I"), (end + 16, "<I"))


def _floats(data: bytes) -> Iterator[Field]:
    yield from ((at, "<f") for at in range(0, len(data) - 3, 4))


def _stl(data: bytes, random: Random) -> bytes:
    if data.startswith(b"solid"):
        return text(data, random)
    fields = [(80, "<I")] + [(at, "<f") for at in range(84, min(len(data), 400) - 3, 2)]
    return _overwritten(data, fields, random)


def _glb(data: bytes, random: Random) -> bytes:
    """Lengths of the file and of its chunks, or the JSON with a length that fits."""
    length = _at(data, 12, "<I")
    if random.random() < 0.2:
        places = [(4, "<I"), (8, "<I"), (12, "<I"), (16, "<I"), (20 + length, "<I")]
        return _overwritten(data, places, random)
    head = text(data[20 : 20 + length], random)
    head += b" " * (-len(head) % 4)
    after = data[20 + length :]
    size = struct.pack("<II", 20 + len(head) + len(after), len(head))
    return data[:8] + size + data[16:20] + head + after


def _pcap(data: bytes) -> Iterator[Field]:
    yield from ((0, "<I"), (4, "<H"), (6, "<H"), (16, "<I"), (20, "<I"))
    at = 24
    while at + 16 <= len(data):
        yield from ((at + 4, "<I"), (at + 8, "<I"), (at + 12, "<I"), (at + 28, ">H"))
        yield from ((at + 30, "<B"), (at + 32, ">H"), (at + 36, ">H"), (at + 39, "<B"))
        yield from ((at + 50, ">H"), (at + 52, ">H"), (at + 54, ">H"))
        at += 16 + _at(data, at + 8, "<I")


def _pcapng(data: bytes) -> Iterator[Field]:
    at = 0
    while at + 12 <= len(data) and (length := _at(data, at + 4, "<I")) >= 12:
        yield from ((at + k, "<I") for k in range(0, min(length, 32), 4))
        yield from ((at + k, "<H") for k in range(8, min(length, 64), 2))
        yield (at + length - 4, "<I")
        at += length


def _ros1(data: bytes) -> Iterator[Field]:
    at = data.find(b"\n") + 1
    while at + 4 <= len(data):
        head = _at(data, at, "<I")
        yield (at, "<I")
        place = at + 4
        while place < min(at + 4 + head, len(data)):
            size = _at(data, place, "<I")
            value = data.find(b"=", place, place + 4 + size) + 1
            yield (place, "<I")
            wide = place + 4 + size - value
            yield from [(value, {1: "<B", 4: "<I", 8: "<Q"}[wide])] if wide in {1, 4, 8} else []
            place += 4 + size
        body = at + 4 + head
        yield from ((body + k, "<I") for k in range(0, 40, 4))
        at = body + 4 + _at(data, body, "<I")


def _sqlite(data: bytes) -> Iterator[Field]:
    yield from ((16, ">H"), (18, ">B"), (19, ">B"), (20, ">B"), (21, ">B"))
    yield from ((at, ">I") for at in range(24, 100, 4))
    page = _at(data, 16, ">H") or 4096
    for start in range(0, len(data), page):
        at = start + (100 if start == 0 else 0)
        yield from ((at, ">B"), (at + 1, ">H"), (at + 3, ">H"), (at + 5, ">H"), (at + 8, ">I"))
        cells = min(_at(data, at + 3, ">H"), 20)
        yield from ((at + 8 + 2 * k, ">H") for k in range(cells))
        for k in range(cells):
            cell = start + _at(data, at + 8 + 2 * k, ">H")
            yield from ((cell + place, ">B") for place in range(12))


def _mcap(data: bytes) -> Iterator[Field]:
    at = 8
    while at + 9 <= len(data) - 8:
        length = _at(data, at + 1, "<Q")
        yield from ((at, "<B"), (at + 1, "<Q"))
        yield from ((at + 9 + k, "<Q") for k in range(0, min(length, 72), 4))
        yield from ((at + 9 + k, "<H") for k in range(0, min(length, 72), 2))
        yield from ((at + 9 + k, "<I") for k in range(0, min(length, 72), 2))
        at += 9 + length


def _parquet(data: bytes) -> Iterator[Field]:
    """Bytes of the footer (Thrift), and its length; heads of pages are anywhere."""
    begin = max(4, len(data) - 8 - _at(data, len(data) - 8, "<I"))
    yield (len(data) - 8, "<I")
    yield from ((at, "<B") for at in range(begin, len(data) - 8))
    yield from ((at, "<I") for at in range(begin, len(data) - 8, 3))
    yield from ((at, "<B") for at in range(4, min(begin, 200)))


def _safetensors(data: bytes, random: Random) -> bytes:
    """The length of the JSON, or the JSON with a length that fits."""
    if random.random() < 0.2:
        return _overwritten(data, [(0, "<Q")], random)
    length = _at(data, 0, "<Q")
    head = text(data[8 : 8 + length], random)
    return struct.pack("<Q", len(head)) + head + data[8 + length :]


def _nested(data: bytes, random: Random) -> bytes:
    """Text, or a value that is nested deeply or far too long."""
    if random.random() < 0.9:
        return text(data, random)
    depth = limit(random, 16)
    deep = ("[" * depth + "]" * depth, '{"a":' * depth + "1" + "}" * depth, "9" * depth)
    return (deep[random.integers(3)]).encode()


def _aliased(data: bytes, random: Random) -> bytes:
    """YAML of `_nested`, or with anchors that unfold to more than there are atoms."""
    if random.random() < 0.9:
        return _nested(data, random)
    levels = int(random.integers(2, 60))
    rows = ["a0: &a0 [x, x]"] + [
        f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * 9)}]" for level in range(1, levels)
    ]
    merged = f"\ndatasets: *a{levels - 1}\n<<: *a{levels - 1}" if random.random() < 0.5 else ""
    return ("\n".join(rows) + merged).encode()


def json_of(value: object) -> bytes:
    """JSON as `puckbench` writes it."""
    return json.dumps(value, indent=1, sort_keys=True).encode()


WRITERS: dict[str, Callable[[bytes, Random], bytes]] = {
    **dict.fromkeys((".las", ".laz"), _by(_las)),
    ".e57": _e57,
    ".ply": header(b"end_header"),
    ".pcd": header(b"\nDATA"),
    **dict.fromkeys((".xyz", ".csv", ".pts", ".obj", ".off"), text),
    ".npy": _npy,
    ".npz": _npz,
    ".bin": _by(_floats),
    ".stl": _stl,
    ".glb": _glb,
    ".pcap": _by(_pcap),
    ".pcapng": _by(_pcapng),
    ".bag": _by(_ros1),
    ".db3": _by(_sqlite),
    ".mcap": _by(_mcap),
    ".parquet": _by(_parquet),
    ".yaml": _aliased,
    ".json": _nested,
    ".safetensors": _safetensors,
    ".index": _by(lambda data: ((at, "<B") for at in range(len(data)))),
}
"""What writes a structured file of a format, by its suffix."""
