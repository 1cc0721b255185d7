from __future__ import annotations

import argparse
import getpass
import platform
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pointkit.errors import InputError

if TYPE_CHECKING:
    from puckbench.planning.bundling import Published

_TOO_COMMON = ("root", "user")
"""Names of users that say nothing, and stand in many texts."""
_MOST_NAMED = 3


def arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    text = "folder of results of a run; call this command where the run was started"
    add("results", type=Path, help=text)
    text = "configuration of the run (default: RESULTS/config.yaml)"
    add("--config", type=Path, metavar="FILE", help=text)
    add("--to", type=Path, metavar="FILE", help="bundle to write (.zip; default: RESULTS.zip)")
    text = "include all streams; their digests are always included"
    add("--streams", action="store_true", help=text)


def run(options: argparse.Namespace) -> dict[str, Any] | str:
    """Write a bundle, and return what it contains and what a person should look at.

    The answer is text or, with ``--json``, a mapping of values.
    """
    from puckbench.core.archives import SUFFIX
    from puckbench.planning.bundling import digest_of, published
    from puckbench.results.bundles import write_bundle

    if not options.results.is_dir():
        raise InputError(f"{options.results}: no such folder of results")
    config = options.config or options.results / "config.yaml"
    if not config.exists():
        raise InputError(f"{config}: no such file; name the configuration of the run (--config)")
    file = options.to or Path(f"{options.results.resolve().name}{SUFFIX}")
    if file.suffix.lower() != SUFFIX:
        raise InputError(f"--to {file}: a bundle is a {SUFFIX} file")
    bundle = published(options.results, config, options.streams)
    write_bundle(file, bundle.manifest, bundle.members)
    whole = digest_of(file)
    answer = {
        "file": str(file),
        "bytes": whole.bytes,
        "sha256": whole.sha256,
        "files": len(bundle.members) + 1,
        "streams": sum(map(len, bundle.manifest.streams.values())),
        "look_at": dict(_to_look_at(bundle)),
    }
    return answer if options.json else _text(answer, options.streams)


def _to_look_at(bundle: Published) -> Iterator[tuple[str, str]]:
    from puckbench.planning.bundling import private_parts
    from puckbench.results.bundles import CONFIGURATION, MANIFEST, RESULTS

    yield CONFIGURATION, "titles, and names of data and files"
    for name in bundle.members:
        if name != CONFIGURATION and not name.startswith(RESULTS):
            yield name, "your code" if name in bundle.manifest.plugins else "your settings"
    inputs = len(bundle.manifest.inputs)
    yield MANIFEST, f"names of {inputs} input files, processor, versions, date of the run"
    if bundle.manifest.commit.endswith("-dirty") or not bundle.manifest.commit:
        commit = bundle.manifest.commit or "unknown"
        yield f"commit {commit}", "others cannot install the sources of puckbench that were run"
    for word, names in private_parts(bundle, _private_words()).items():
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        yield repr(word), f"stands in {', '.join(names[:_MOST_NAMED])}{more}"


def _private_words() -> list[str]:
    """Return names that may tell who made a bundle and where: of user, machine and folders."""
    words = [str(Path.home()), str(Path.cwd()), platform.node()]
    with suppress(KeyError, OSError):  # a user without a name, as in some containers
        words.append(getpass.getuser())
    return [word for word in dict.fromkeys(words) if len(word) > 2 and word not in _TOO_COMMON]


def _text(answer: Mapping[str, Any], with_streams: bool) -> str:
    from puckbench.planning.run_summary import aligned

    streams = f"{answer['streams']} streams{'' if with_streams else ' by their digests'}"
    lines = [
        f"{answer['file']}: {answer['files']} files, {streams}, {answer['bytes']:,} bytes",
        f"SHA-256: {answer['sha256']}",
        "Before you publish it, look at",
        *(f"  {line}" for line in aligned([*answer["look_at"].items()])),
        f"To check it: puckbench verify {answer['file']} --run NEW_FOLDER",
    ]
    return "\n".join(lines)
