"""Columns of PointCloud2 messages: structured arrays of NumPy as the independent source; damage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pointkit.errors import InputError
from puck.recordings.point_cloud2 import point_columns

NUMBERS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


@dataclass(frozen=True)
class Field:
    name: str
    offset: int
    datatype: int
    count: int


@dataclass(frozen=True)
class Layout:
    height: int
    width: int
    fields: list[Field]
    is_bigendian: bool
    point_step: int
    row_step: int


@dataclass(frozen=True)
class Message(Layout):
    data: NDArray[np.uint8]


def message_of(rows: NDArray[Any], row_padding: int = 0) -> Message:
    """The message of a structured array (height, width), as a driver lays it out."""
    kind = rows.dtype
    fields, is_big = [], False
    for name in kind.names or ():
        part, offset = (kind.fields or {})[name][:2]
        base = part.base.newbyteorder("=")
        is_big |= part.base.byteorder == ">"
        count = int(np.prod(part.shape, dtype=int))
        fields.append(Field(name, offset, NUMBERS[base.str[1:]], count))
    row_step = kind.itemsize * rows.shape[1] + row_padding
    data = b"".join(row.tobytes() + b"\xa5" * row_padding for row in rows)
    steps = (kind.itemsize, row_step)
    return Message(*rows.shape, fields, is_big, *steps, np.frombuffer(data, np.uint8))


@st.composite
def arrays(draw: st.DrawFn) -> NDArray[Any]:
    """Structured arrays with gaps before, between and after fields, in any order."""
    order = draw(st.sampled_from("<>"))
    kinds = draw(
        st.lists(st.tuples(st.sampled_from(sorted(NUMBERS)), st.integers(1, 3)), max_size=5)
    )
    places, end = [], 0
    for kind, count in kinds:
        offset = end + draw(st.integers(0, 3))
        places.append((offset, (order + kind, (count,) if count > 1 else ())))
        end = offset + count * np.dtype(kind).itemsize
    places = draw(st.permutations(places))
    layout = {
        "names": [f"f{number}" for number in range(len(places))],
        "formats": [kind for _, kind in places],
        "offsets": [offset for offset, _ in places],
        "itemsize": end + draw(st.integers(1, 4)),
    }
    rows = np.zeros((draw(st.integers(0, 3)), draw(st.integers(0, 4))), np.dtype(layout))
    data = draw(st.binary(min_size=rows.nbytes, max_size=rows.nbytes))
    return np.frombuffer(data, rows.dtype).reshape(rows.shape)


@given(arrays(), st.integers(0, 5))
def test_columns_are_the_fields_of_the_structured_array(rows: NDArray[Any], padding: int) -> None:
    columns = point_columns(message_of(rows, padding))
    expected = {}
    for name in rows.dtype.names or ():
        (count,) = rows.dtype[name].shape or (1,)
        values = rows[name].reshape(rows.size, count)
        names = [name] if count == 1 else [f"{name}_{part}" for part in range(count)]
        expected |= {part: values[:, place] for place, part in enumerate(names)}
    assert list(columns) == list(expected)
    for name, values in expected.items():
        native = values.astype(values.dtype.newbyteorder("="))
        assert columns[name].dtype == native.dtype
        assert columns[name].tobytes() == native.tobytes()


ROWS = np.zeros((2, 3), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("ring", "<u2"), ("_", "u1", 2)])
ROWS["ring"] = np.arange(6).reshape(2, 3)
WHOLE = message_of(ROWS)


def test_fields_of_padding_are_no_columns_and_a_count_of_0_is_1() -> None:
    fields = [replace(field, count=0) for field in WHOLE.fields[:4]]
    for message in (WHOLE, replace(WHOLE, fields=fields)):
        columns = point_columns(message)
        assert list(columns) == ["x", "y", "z", "ring"]
        assert columns["ring"].tolist() == [0, 1, 2, 3, 4, 5]


def test_the_row_step_of_a_single_row_is_not_needed() -> None:
    message = replace(message_of(ROWS[:1]), row_step=0)
    assert point_columns(message)["ring"].tolist() == [0, 1, 2]


def test_padding_after_the_last_row_may_lack() -> None:
    message = message_of(ROWS, 7)
    columns = point_columns(replace(message, data=message.data[:-7]))
    assert columns["ring"].tolist() == [0, 1, 2, 3, 4, 5]


LONG = "a\n" * 500


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"data": WHOLE.data[:-1]}, "95 bytes of data are not 2 x 3 points of 16 bytes"),
        ({"height": 1 << 31}, "96 bytes of data are not 2147483648 x 3 points"),
        ({"width": 1 << 31}, "rows of 48 bytes are too short for 2 x 2147483648 points"),
        ({"row_step": 47}, "rows of 47 bytes are too short for 2 x 3 points of 16 bytes"),
        ({"point_step": 0}, "96 bytes of data are not 2 x 3 points of 0 bytes"),
        ({"fields": [Field("x", 13, 7, 1)]}, "field 'x' does not fit in points of 16 bytes"),
        ({"fields": [Field("x", 0, 7, 1 << 31)]}, "field 'x' does not fit in points of 16"),
        ({"fields": [Field("x", 0, 7, 3), Field("y", 0, 8, 1)]}, "field 'y' does not fit"),
        (
            {"width": 0, "point_step": 1 << 31, "fields": [Field("x", 0, 2, 1 << 30)]},
            "of more than",
        ),
        ({"fields": [Field("x", 0, 9, 1)]}, "field 'x' has the unknown type 9"),
        ({"fields": [Field("x", 0, 0, 1)]}, "field 'x' has the unknown type 0"),
        ({"fields": [Field("x", 0, 7, 1)] * 2}, "two fields are named 'x'"),
        ({"fields": [Field("x", 0, 7, 2), Field("x_1", 8, 7, 1)]}, "two fields are named 'x_1'"),
        ({"fields": [Field(LONG, 0, 9, 1)]}, r"field 'a\\na"),
    ],
)
def test_a_message_that_contradicts_itself_is_refused_in_one_line(
    changes: dict[str, Any], fault: str
) -> None:
    with pytest.raises(InputError, match=fault) as refused:
        point_columns(replace(WHOLE, **changes))
    assert len(str(refused.value).splitlines()) == 1
    assert len(str(refused.value)) < 150


SIZES = st.one_of(st.integers(0, 100), st.integers(0, 2**32 - 1))
FIELDS = st.builds(Field, st.text(max_size=3), SIZES, st.integers(0, 9), SIZES)


@given(
    st.builds(
        Message, SIZES, SIZES, st.lists(FIELDS, max_size=4), st.booleans(), SIZES, SIZES,
        st.binary(max_size=300).map(lambda data: np.frombuffer(data, np.uint8)),
    )
)  # fmt: skip
@settings(max_examples=300)
def test_any_message_is_columns_no_larger_than_its_data_or_an_error(message: Message) -> None:
    try:
        columns = point_columns(message)
    except InputError:
        return
    assert sum(column.nbytes for column in columns.values()) <= len(message.data)
    assert all(len(column) == message.height * message.width for column in columns.values())
