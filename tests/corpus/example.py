"""Text clouds as every program writes them."""

from tests.corpus.case import Case, content

CASES = [
    Case("plain.xyz", content("1 2 3\n4 5 6\n"), "cloud", points=[(1, 2, 3), (4, 5, 6)]),
    Case("empty.xyz", content(""), "cloud", line="empty.xyz: the cloud is empty"),
]
