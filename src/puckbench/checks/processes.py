"""Checks that encoding and decoding depend on nothing but their arguments.

The same cloud and rate must give the same bytes, and a stream the same points, in any process.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from puckbench.checks.clouds import least_bits
from puckbench.checks.elsewhere import RANDOM
from puckbench.checks.registry import CHECKS, Advice, Fault, LeftOut
from puckbench.checks.subject import Subject

_ALONE = "put all that the decoder needs into the stream"


@CHECKS.register("determinism", rank=90, advice="encode must not depend on earlier calls")
def determinism(subject: Subject) -> str:
    """Encode and decode again, after other clouds, without shared work."""
    subject.encode(subject.surface(384), subject.finest)
    for rate, stream in subject.streams.items():
        if subject.encode(subject.cloud, rate) != stream:
            raise Fault(
                f"{rate}: a second encoding gives other bytes: take random numbers from a "
                "generator with a fixed seed, and write no time (gzip: -n) and no set in its order"
            )
        again = subject.decode(stream).xyz
        if not np.array_equal(again, subject.decoded[rate].xyz):
            raise Fault(f"{rate}: a second decoding gives other points: {_ALONE}")
    return "equal bytes and points when called again"


@CHECKS.register("new_process", rank=100, advice=_ALONE, seconds=90.0)
def new_process(subject: Subject) -> str:
    """Decode in a new process, and encode there with another seed of Python's hashes."""
    elsewhere = subject.elsewhere
    if elsewhere.ended:
        raise Fault(f"decoding in a new process: {elsewhere.ended}: {_ALONE}")
    for name, error in elsewhere.errors.items():
        raise Fault(f"{name}: a new process does not decode the stream ({error}): {_ALONE}")
    for rate, decoded in subject.decoded.items():
        if not np.array_equal(decoded.xyz, elsewhere.points[rate]):
            raise Fault(f"{rate}: a new process decodes other points: {_ALONE}")
    for rate, is_same in elsewhere.same_bytes.items():
        if not is_same:
            raise Fault(
                f"{rate}: a new process encodes other bytes: sort what comes out of a set, whose "
                "order depends on PYTHONHASHSEED, and keep nothing between calls"
            )
    return "decodes and encodes the same"


@CHECKS.register("side_information", rank=110, advice=_ALONE, seconds=90.0)
def side_information(subject: Subject) -> str:
    """Look for files through which encoder and decoder exchange data, and count bits.

    Points at random cannot be compressed below a known number of bits.
    """
    elsewhere = subject.elsewhere
    if elsewhere.ended or elsewhere.errors:
        raise LeftOut("the streams do not decode in a new process")
    if shared := sorted(subject.written & elsewhere.read):
        raise Fault(f"decode reads {shared[0]}, which encode has written: {_ALONE}")
    stream = subject.random_stream
    line = "no files" if stream is None else _enough_bits(subject, stream)
    if left := sorted(filter(Path.is_file, subject.written)):
        raise Advice(
            f"encode leaves {left[0]}: write into a folder of puckbench.codecs.external.folder()"
        )
    return line


def _enough_bits(subject: Subject, stream: bytes) -> str:
    from pykdtree.kdtree import KDTree

    original = subject.random.xyz / subject.unit
    decoded = np.unique(subject.elsewhere.points[RANDOM] / subject.unit, axis=0)
    errors = KDTree(decoded).query(original)[0]
    bits = 8 * len(stream)
    least = least_bits(len(original), len(decoded), errors)
    if bits < least:
        raise Fault(
            f"{subject.finest}: {bits} bits for {len(original)} random points, and errors up to "
            f"{errors.max():.2g} grid steps need {least:.0f}: the decoder gets points from "
            f"elsewhere than the stream: {_ALONE}"
        )
    each, needed = bits / len(original), max(0.0, least) / len(original)
    return f"random points: {each:.3g} bits each, at least {needed:.3g} are needed"


@CHECKS.register("shared_work", rank=95, advice="encode must give the same with and without work")
def shared_work(subject: Subject) -> str:
    """Encode the finest rate first, with the object of `prepare`."""
    work = subject.codec.prepare(subject.cloud)
    if work is None:
        raise LeftOut("it has no `prepare`")
    for rate in reversed(subject.rates):
        if subject.encode(subject.cloud, rate, work) != subject.streams[rate]:
            raise Fault(
                f"{rate}: other bytes if another rate was coded before with the same `work`: "
                "store in it only what does not depend on the rate"
            )
    return "rates in another order give the same bytes"
