"""Leaps of a sensor's clock, told apart from packets that are late or lost.

A sensor sends packets at equal intervals, between which it turns by equal angles. Where its clock
leaps, as when GPS or PTP sets it, the sensor has turned by the usual angle. Where packets are late
or lost, it has turned as far as the clock says.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pointkit.geometry.cloud import Floats
from pointkit.lidar.returns import HOUR_US
from pointkit.lidar.turns import CENTIDEGREES, clock_steps
from puck.recordings.ouster import packet_times, revolutions
from puck.recordings.packets import PACKET

LEAP_US = 5e5
"""Smallest step of a clock, in us, that is a leap however far the sensor has turned."""
FEWEST_STEPS = 15
"""Least number of steps between packets from which the usual step is estimated."""
MOST_USUAL, MOST_OFF = 1.5, 0.5
"""Limits of usual steps and of deviations from the usual angle, relative to the medians."""
_RATE_OFF = 0.02
"""Limit of changes of the rotation rate, by which the angle during a loss differs."""
_NEAR, _ENOUGH, _FAR = 5, 3, 64
"""Numbers of packets on each side of a step: those whose medians are compared, the least that
decide where the angles do not, and those whose times of reception then decide."""
_LEAST = 1.25
"""Smallest leap, relative to the usual step; late packets change the median by one step."""
_MANY = 6
"""Number of packets that are sorted to find the usual step."""
_RECEIVED_ALIKE = 0.1
"""Limit of the difference between a step of the clock and the time between receptions.

The limit is a share of the step. Below it, a large step is a pause, not a leap.
"""


class Motion(NamedTuple):
    """Clock and rotation of a sensor between successive packets.

    Parameters
    ----------
    steps_us
        Steps of the clock, (p - 1,), in us.
    rises
        Angles by which the sensor turns, (p - 1,), as shares of a turn.
    counts_turns
        Whether `rises` include whole turns, as packets of an Ouster number them. Otherwise they are
        -0.5 to 0.5.
    """

    steps_us: Floats
    rises: Floats
    counts_turns: bool


def packet_steps(payloads: NDArray[np.uint8], packet: np.dtype[Any]) -> Floats:
    """Return the steps of the sensor's clock between packets, (p - 1,), in us.

    Parameters
    ----------
    payloads
        Packets of one sensor, (p, bytes).
    packet
        Structure of a packet: `PACKET` of a Velodyne, or that of an Ouster.
    """
    packets = payloads.view(packet)[:, 0]
    if packet == PACKET:
        return clock_steps(packets["time_us"].astype(np.float64), HOUR_US)
    return np.diff(packet_times(packets)) / 1000


def motion_of(payloads: NDArray[np.uint8], packet: np.dtype[Any], columns: int = 0) -> Motion:
    """Return the motion of a sensor from its packets.

    Parameters
    ----------
    payloads
        Packets of one sensor, (p, bytes).
    packet
        Structure of a packet: `PACKET` of a Velodyne, or that of an Ouster.
    columns
        Number of columns in a revolution of an Ouster.
    """
    packets, steps_us = payloads.view(packet)[:, 0], packet_steps(payloads, packet)
    if packet == PACKET:
        azimuths = packets["blocks"]["azimuth"][:, 0].astype(np.float64)
        rises = clock_steps(azimuths, CENTIDEGREES) / CENTIDEGREES
        return Motion(steps_us, rises, False)
    numbers = revolutions(packets) * columns + packets["columns"]["column"][:, 0]
    return Motion(steps_us, np.diff(numbers) / columns, True)


def find_leaps(motion: Motion, received: Floats | None = None) -> NDArray[np.bool_]:
    """Return at which steps the clock leaps, (p - 1,).

    Steps of 0.5 s or more are leaps, unless packets were received as far apart. Smaller steps are
    leaps if the sensor has turned by the usual angle, but the clock says that it has turned by
    another. If the angles agree, as at steps of whole turns, a step back is a leap if the clock
    does not return to where it was within some packets, and a step forward is one if the times of
    reception contradict it.

    Parameters
    ----------
    motion
        Clock and rotation of the sensor.
    received
        Times at which the packets were received, (p,), in s. If they are None, each step that may
        be a leap is one.
    """
    steps = motion.steps_us
    is_leap = np.abs(steps) >= LEAP_US
    if received is not None:
        is_leap &= np.abs(np.diff(received) * 1e6 - steps) >= _RECEIVED_ALIKE * np.abs(steps)
    return is_leap | _small_leaps(motion, received)


def _small_leaps(motion: Motion, received: Floats | None) -> NDArray[np.bool_]:
    """Return which steps of less than 0.5 s are leaps, as for `find_leaps`."""
    steps, rises, counts_turns = motion
    is_leap = np.zeros(len(steps), np.bool_)
    if len(steps) < FEWEST_STEPS:
        return is_leap
    usual, rise = _usual(steps), _usual(rises)
    if usual <= 0:
        return is_leap
    is_odd = (np.abs(steps) < LEAP_US) & ((steps < 0) | (steps > MOST_USUAL * usual))
    places = np.flatnonzero(is_odd)
    ahead = np.append(0, np.cumsum(steps - usual))
    moved = _change(ahead, places)
    turned = _change(np.append(0, np.cumsum(rises - rise)), places)
    apart = turned - moved / usual * rise
    if not counts_turns:
        turned, apart = turned - np.rint(turned), apart - np.rint(apart)
    runs_on = np.abs(turned) <= MOST_OFF * abs(rise)
    runs_on &= np.abs(moved) > _LEAST * usual
    runs_on &= np.sign(moved) * (steps[places] - usual) > MOST_OFF * np.abs(moved)
    most_apart = (MOST_OFF + _RATE_OFF * np.abs(moved) / usual) * abs(rise)
    for k in np.flatnonzero(runs_on).tolist():
        at, leap = int(places[k]), float(moved[k])
        if abs(apart[k]) > most_apart[k]:
            is_leap[at] = True
        elif leap < 0:
            is_leap[at] = min(at + 1, len(steps) - at) >= _ENOUGH
        else:
            is_leap[at] = received is None or _contradict(received, steps, at, leap)
    return is_leap


def clock_epochs(motion: Motion, is_leap: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return how often the clock has leapt when a packet was sent, (p,), from `find_leaps`.

    Where packets are late at a leap, so that the clock seems to leap there and back, each packet is
    counted to the nearer clock.
    """
    steps, places = motion.steps_us, np.flatnonzero(is_leap)
    epochs = np.append(0, np.cumsum(is_leap))
    if len(places) < 2:
        return epochs
    ahead = np.append(0, np.cumsum(steps - _usual(steps)))
    for group in np.split(places, np.flatnonzero(np.diff(places) >= _NEAR) + 1):
        first, last = int(group[0]), int(group[-1])
        if first < last < first + _NEAR:
            inside = slice(first + 1, last + 1)
            off = [np.abs(ahead[inside] - ahead[each]) for each in (first, last + 1)]
            epochs[inside] = np.where(off[0] <= off[1], epochs[first], epochs[last + 1])
    return epochs


def _usual(steps: Floats) -> float:
    """Return the usual step between packets, of which a few may be late or lost."""
    places = np.append(0, np.cumsum(steps))
    groups = places[: len(places) // _MANY * _MANY].reshape(-1, _MANY)
    return float(np.median(np.diff(np.sort(groups, axis=1))))


def _change(values: Floats, places: NDArray[np.intp]) -> Floats:
    """Return by how much the median of the values (p,) near a step changes at each of `places`."""
    padded = np.pad(values, _NEAR, constant_values=np.nan)
    after = places[:, None] + 1 + _NEAR + np.arange(_NEAR)
    before = after - _NEAR
    change: Floats = np.nanmedian(padded[after], axis=1) - np.nanmedian(padded[before], axis=1)
    return change


def _contradict(received: Floats, steps: Floats, at: int, leap: float) -> bool:
    """Return whether packets were received as if the clock leapt forward by `leap` us."""
    first = max(at + 1 - _FAR, 0)
    elapsed = np.append(0, np.cumsum(steps[first : at + _FAR]))
    behind = 1e6 * received[first : first + len(elapsed)] - elapsed
    change = np.median(behind[at + 1 - first :]) - np.median(behind[: at + 1 - first])
    return bool(change < -0.5 * leap)
