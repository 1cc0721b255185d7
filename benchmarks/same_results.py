"""Whether two results folders hold the same bytes, times aside.

    python benchmarks/same_results.py RESULTS OTHER_RESULTS

Prints what differs; exit status 1 when anything does.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
from tests.support.same_results import compared, differences


def main() -> None:
    folder, reference = (Path(word) for word in sys.argv[1:3])
    found = differences(folder, reference)
    print("\n".join(found) or f"the same, times aside: {len(list(compared(folder)))} files")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
