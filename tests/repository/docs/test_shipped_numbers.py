"""The numbers of the pages are those of the shipped reference results and measurements."""

import re
from types import ModuleType

import pandas as pd
import pytest

from tests.support.pages import extension, page


@pytest.fixture(scope="module")
def numbers() -> ModuleType:
    """The module that writes numbers into the pages (`make pages`)."""
    return extension("shipped_numbers")


def test_pages_have_todays_numbers(numbers: ModuleType) -> None:
    texts = {path: path.read_text(encoding="utf-8") for path in numbers.pages()}
    marked = {path: text for path, text in texts.items() if numbers.MARKER.search(text)}
    assert len(marked) >= 8
    assert [str(path) for path, text in marked.items() if numbers.renewed(text) != text] == []


def test_every_number_is_shown_somewhere(numbers: ModuleType) -> None:
    texts = [path.read_text(encoding="utf-8") for path in numbers.pages()]
    shown = {found[2] for text in texts for found in numbers.MARKER.finditer(text)}
    assert shown == numbers.SHOWN.keys()


def test_a_page_with_other_numbers_is_noticed(numbers: ModuleType) -> None:
    page = "Bits: <!-- shown: noise_saved_puck -->{}<!-- end -->."
    assert numbers.renewed(page.format("99 %")) == page.format(numbers.noise_saved_puck())


def test_ratios_have_an_interval_from_six_scenes_on(numbers: ModuleType) -> None:
    bits = pd.Series([2.0, 2.2, 1.8, 2.1, 1.9, 2.0], index=list("abcdef"))
    assert numbers.ratio_text(bits, bits / 2) == "2.00 (2.00 to 2.00)"
    assert numbers.ratio_text(bits[:5], bits[:5] / 2) == "2.00 (5 scenes)"


def test_a_figure_of_performance_that_was_not_measured_is_noticed(numbers: ModuleType) -> None:
    assert numbers.measured_rows("scans", "none", unit="processor s")
    for subject, part in (("scans", "no such room"), ("no such subject", "none")):
        with pytest.raises(LookupError, match=f"no row of {subject}"):
            numbers.measured_rows(subject, part)


def test_the_page_of_performance_has_every_row(numbers: ModuleType) -> None:
    text = page("docs/notes/performance.md")
    for name, subject in numbers.measured().items():
        section = text.partition(f"`make measure SUBJECTS={name}`: ")[2].partition("\n## ")[0]
        assert f"commit `{subject['commit']}`" in section
        values = re.findall(r"^\| ([^|]+) \| [\d.,e-]+ ([^|]+) \|", section, re.MULTILINE)
        assert values == [(row["what"], row["unit"]) for row in subject["rows"]]


def test_pages_type_no_times_of_ours(numbers: ModuleType) -> None:
    """Notes tell what was measured once; pages for users quote what was measured last."""
    typed = re.compile(r"\btakes? (?:at most )?\d[\d.,]*(?: to \d[\d.,]*)? (?:s|ms|min|minutes)\b")
    for path in numbers.pages():
        if path.parent.name != "notes":
            text = " ".join(numbers.MARKER.sub("", path.read_text(encoding="utf-8")).split())
            assert not typed.findall(text), path
