"""Compression of what spinning LiDARs measure, without loss or with quantised ranges.

A turn, i.e. one revolution of the sensor, is coded as azimuths, times, reflectivities and an image
of ranges, with a row for each laser and a column for each firing of all lasers. `compress` and
`decompress` restore recorded files bit for bit; `encode_returns` and `decode_returns` code decoded
returns; a `Writer` and `read_turns` code turns while the sensor sends them.
"""

from typing import TYPE_CHECKING

from pointkit.lazy import lazy

if TYPE_CHECKING:
    from puck.options import CodingOptions as CodingOptions
    from puck.recording import compress as compress
    from puck.recording import decompress as decompress
    from puck.recordings.packet_turns import packet_kind as packet_kind
    from puck.recordings.packet_turns import packets_of as packets_of
    from puck.returns import decode_returns as decode_returns
    from puck.returns import encode_returns as encode_returns
    from puck.returns import encode_turns as encode_turns
    from puck.returns import range_steps as range_steps
    from puck.returns import reflectivity_bytes as reflectivity_bytes
    from puck.smoothing import smoothed_points as smoothed_points
    from puck.turn_streams import Writer as Writer
    from puck.turn_streams import decode_turns as decode_turns
    from puck.turn_streams import read_turns as read_turns

__getattr__, __dir__, __all__ = lazy(
    __name__,
    options=("CodingOptions",),
    recording=("compress", "decompress"),
    returns=(
        "decode_returns",
        "encode_returns",
        "encode_turns",
        "range_steps",
        "reflectivity_bytes",
    ),
    smoothing=("smoothed_points",),
    turn_streams=("Writer", "decode_turns", "read_turns"),
    **{"recordings.packet_turns": ("packet_kind", "packets_of")},
)
