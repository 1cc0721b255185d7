"""The numbers of the pages are those of the shipped reference results."""

from types import ModuleType

import pandas as pd
import pytest

from tests.support.pages import extension


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
