from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from jenco2022.claims import cloud_statistics, rate_distortion, sensor_errors
from jenco2022.claims.evidence import Evidence
from jenco2022.claims.verdicts import Part
from pointkit.yaml_files import read_yaml

Test = Callable[[Evidence], list[Part]]


@dataclass(frozen=True)
class Claim:
    """A claim of the thesis, with the function that tests it.

    Parameters
    ----------
    words
        The claim, as a sentence.
    section
        Section of the thesis that makes the claim, such as "6.2".
    test
        Function that takes an `Evidence`, the tables of a run, and returns a result for each part
        of the claim. Parts that these tables cannot decide have results without a verdict.
    figures
        Names of puckbench's figures that show what the claim is about.
    thesis
        What the thesis measured, or empty.
    thesis_figure
        Numbers of the thesis's figures that show this, or empty.
    """

    words: str
    section: str
    test: Test
    figures: tuple[str, ...]
    thesis: str = ""
    thesis_figure: str = ""


_TESTS: dict[str, Test] = {
    f"{module.__name__.rpartition('.')[2]}.{name}": function
    for module in (cloud_statistics, rate_distortion, sensor_errors)
    for name, function in vars(module).items()
}


def _claim(*, test: str, figures: list[str], **texts: str) -> Claim:
    return Claim(test=_TESTS[test], figures=tuple(figures), **texts)


CLAIMS = tuple(_claim(**entry) for entry in read_yaml(Path(__file__).with_suffix(".yaml")))
"""The claims in the order of docs/notes/claims.md, numbered from 1."""
