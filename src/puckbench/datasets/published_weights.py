"""The weights of PCGCv1's, PCGCv2's and RENO's authors, from public repositories at fixed commits.

What is fetched from where, with its hashes, is in published_weights.yaml and reno_weights.yaml.
"""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from puckbench.core.errors import InputError, naming

HOST = "https://raw.githubusercontent.com"
_TIMEOUT_S = 60
_MAX_BYTES = 2**26
_OPTIMISER = "main_optimizer/"


PCGC, RENO = "pcgc_weights", "reno_weights"
_TABLES = {PCGC: "published_weights.yaml", RENO: "reno_weights.yaml"}


def table(name: str = PCGC) -> dict[str, Any]:
    """Repositories, files and the order of variables, as the set's YAML has them."""
    import yaml

    text = Path(__file__).with_name(_TABLES[name]).read_text(encoding="utf-8")
    found: dict[str, Any] = yaml.safe_load(text)
    return found


def download(
    folder: Path, host: str = HOST, known: Mapping[str, Any] | None = None, name: str = PCGC
) -> Path:
    """Fetch the weights and their licences into one package, every file with its known hash.

    Parameters
    ----------
    folder
        Where the package is put.
    host
        Beginning of all addresses.
    known
        As `table`, which is the default.
    name
        Of the set.

    Returns
    -------
    Path
        A tar archive, the same at every download.

    Raises
    ------
    InputError
        There is no network, or a file is not the known one.
    """
    known = known or table(name)
    package = folder / f"{name}.tar"
    with tarfile.open(package, "w") as archive:
        for file, about in known["files"].items():
            content = _file(file, about, partial(_fetched, host, known["repositories"]), known)
            member = tarfile.TarInfo(file)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))
    return package


def _file(
    name: str, about: Mapping[str, Any], fetched: Callable[[str], bytes], known: Mapping[str, Any]
) -> bytes:
    """One file to keep; InputError when it has not the known hash."""
    parts = [fetched(place) for place in about["from"]]
    if "git" in about and [_git_name(part) for part in parts] != about["git"]:
        raise InputError(f"{name}: the repository has other contents than are known here")
    content = parts[0] if len(parts) == 1 else _archive(name, parts, known["order"])
    held = hashlib.sha256(content).hexdigest()
    if held != about.get("sha256", held):
        raise InputError(f"{name} has the SHA-256 {held}, not the known {about['sha256']}")
    return content


def _fetched(host: str, repositories: Mapping[str, str], place: str) -> bytes:
    from urllib.error import URLError
    from urllib.request import urlopen

    repository, _, path = place.partition("/")
    address = f"{host}/{repositories[repository]}/{path}"
    try:
        with urlopen(address, timeout=_TIMEOUT_S) as answer:  # noqa: S310 (the host is ours)
            content: bytes = answer.read(_MAX_BYTES)
    except (URLError, OSError) as error:
        reason = getattr(error, "reason", error)
        otherwise = "without a network, name a folder of weights in the codec's option `weights`"
        raise InputError(f"{address} cannot be fetched ({reason}); {otherwise}") from error
    return content


def _git_name(content: bytes) -> str:
    """The name that git has for a file of this content."""
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()


def _archive(name: str, checkpoint: Sequence[bytes], order: str) -> bytes:
    """The variables of a checkpoint (index, data) as a NumPy archive."""
    import numpy as np

    from puckbench.io.tensorflow_checkpoints import read_variables

    with naming(name):
        variables = read_variables(*checkpoint)
    names = sorted(name for name in variables if not name.startswith(_OPTIMISER))
    places = bytes.fromhex(order)
    if len(names) != len(places):
        raise InputError(f"{name}: {len(names)} variables, not {len(places)}")
    archive = io.BytesIO()
    np.savez(archive, **{names[place]: variables[names[place]] for place in places})  # type: ignore[arg-type]
    return archive.getvalue()


def credits_of_reno(_: Path) -> str:
    """Whose the weights of RENO are."""
    return (
        "# Weights of RENO\n\n"
        "KITTIDetection.pt, SemanticKITTI.pt, Ford.pt: RENO (You, Chen, Ding, Asif, Ma 2025), "
        "github.com/NJUVISION/RENO, MIT License (LICENSE-RENO).\n"
    )


def credits_of(_: Path) -> str:
    """Whose the weights of PCGCv1 and PCGCv2 are."""
    return (
        "# Weights of PCGCv1 and PCGCv2\n\n"
        "* a*.npz: PCGCv1 (Wang, Zhu, Liu, Ma 2021), github.com/NJUVISION/PCGCv1, Apache License "
        "2.0 (LICENSE-PCGCv1). Changed: the variables of the TensorFlow checkpoints as NumPy "
        "archives.\n"
        "* c8_*.pth: PCGCv2 (Wang, Ding, Li, Ma 2021), github.com/NJUVISION/PCGCv2, MIT License "
        "(LICENSE-PCGCv2).\n\n"
        "Both as distributed with PCC Arena (github.com/xtorker/PCCArena).\n"
    )
