"""Whether two results folders hold the same bytes, times aside.

    python benchmarks/same_results.py RESULTS OTHER_RESULTS

Compares every file but logs, the report page and figures of times: tables and rows without their
columns of time and memory, everything else byte by byte. Prints what differs; exit status 1 when
anything does.
"""

from __future__ import annotations

import sys
from pathlib import Path

from puckbench.planning.same_results import compared, differences


def main() -> None:
    folder, reference = (Path(word) for word in sys.argv[1:3])
    found = differences(folder, reference)
    print("\n".join(found) or f"the same, times aside: {len(list(compared(folder)))} files")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
