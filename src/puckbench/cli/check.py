from __future__ import annotations

import argparse
from collections import Counter
from typing import Any

from pointkit.terminal import print_answer
from puckbench.cli.codec_options import add_entry, entry_of


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("codec", help="path/to/file.py:Class, or a name (see `puckbench codecs`)")
    add_entry(parser)


def run(options: argparse.Namespace) -> dict[str, Any]:
    """Run all checks on a codec, print the result of each as soon as it has ended, and count them.

    The answer has the number of checks by outcome and, with ``--json``, the result of each.
    """
    from puckbench.checks.supervision import check_codec

    findings = []
    for finding in check_codec(options.codec, entry_of(options)):
        findings.append(finding)
        if not options.json:
            name = f"{finding.check}, {finding.clouds}" if finding.clouds else finding.check
            print_answer(f"{finding.outcome:8}  {name:26}  {finding.line}")
    counts = Counter(finding.outcome.replace(" ", "_") for finding in findings)
    answer = {name: counts[name] for name in ("passed", "failed", "advice", "left_out")}
    return {**answer, **({"checks": [each._asdict() for each in findings]} if options.json else {})}
