"""Data of point-cloud messages come back bit for bit, whatever they are."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from puck.cloud_data import CloudDecoder, CloudEncoder, CloudField, CloudLayout
from puck.options import EFFORTS, CodingOptions, Effort

FIELD = st.builds(
    CloudField,
    st.sampled_from(["x", "y", "z", "ring", "time", "intensity", "", "ä"]),
    st.integers(0, 24),
    st.integers(0, 9),
    st.integers(0, 3),
)
LAYOUT = st.builds(
    CloudLayout, st.lists(FIELD, max_size=7).map(tuple), st.integers(0, 40), st.booleans()
)


def admit(_: int) -> None:
    """Admit any number of bytes."""


@settings(max_examples=60, deadline=None)
@given(
    layout=LAYOUT, messages=st.lists(st.binary(max_size=600), min_size=1, max_size=3),
    width=st.integers(0, 20), height=st.integers(0, 4), more=st.integers(0, 3),
    effort=st.sampled_from(EFFORTS),
)  # fmt: skip
def test_any_bytes_of_any_layout(
    layout: CloudLayout, messages: list[bytes], width: int, height: int, more: int, effort: Effort
) -> None:
    assert CloudLayout.unpacked(layout.packed()) == layout
    encoder = CloudEncoder(layout, CodingOptions(effort=effort))
    decoder = CloudDecoder(layout)
    row_step = width * layout.point_step + more
    for number, data in enumerate(messages):
        body = encoder.encode(data, width, height, row_step, is_key=number == 0)
        assert decoder.decode(body, admit) == data
