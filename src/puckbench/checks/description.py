"""Checks of what a codec says about itself."""

from __future__ import annotations

from puckbench.checks.registry import CHECKS, Advice, Fault
from puckbench.checks.subject import Subject
from puckbench.codecs.base import CloudKind

_CLOUDS = (
    CloudKind(None),
    CloudKind("scaled"),
    CloudKind("metric"),
    CloudKind("metric", extent_m=1e7),
    CloudKind("metric", True, False, 100.0),
    CloudKind("metric", True, True, 100.0),
)


@CHECKS.register("skip", rank=140, advice="return a reason or None from `skip` for any CloudKind")
def skip(subject: Subject) -> str:
    """Ask for the reasons why the codec does not code several kinds of clouds."""
    reasons = {subject.codec.skip(cloud, rate) for cloud in _CLOUDS for rate in subject.codec.rates}
    for reason in reasons - {None}:
        if not isinstance(reason, str) or not reason.strip() or len(reason.splitlines()) != 1:
            raise Fault(f"skip returns {reason!r}: return a reason in one line, or None")
    return f"{len(reasons - {None})} reasons"


@CHECKS.register("version", rank=150, advice="define `version`, a str")
def version(subject: Subject) -> str:
    """Look at the version."""
    if not isinstance(subject.codec.version, str):
        raise Fault(f"version is {subject.codec.version!r}: make it a str")
    if not subject.codec.version:
        raise Advice('it has no version: set `version = "1"`, and raise it when streams change')
    return subject.codec.version
