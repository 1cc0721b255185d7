from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pointkit.errors import InputError, among, naming
from pointkit.registry import trust
from puckbench.planning.config import checked
from puckbench.planning.plan import Plan
from puckbench.planning.user_files import check_codecs, codec_entries
from puckbench.report.reference_results import ReferenceResults

Options = dict[str, Any]
_NOT_KEPT = (
    *("results", "codecs", "stand_in", "strict", "sensor_study", "thesis"),
    *("train", "train_segmentation", "container", "report"),
)
"""Keys of the study's configuration that do not define clouds or metrics."""


def study_configuration(
    reference: ReferenceResults, codecs: Sequence[str], results: str, datasets: Sequence[str] = ()
) -> Options:
    """Return a configuration that runs the user's codecs on the clouds of a reference study.

    Parameters
    ----------
    reference
        Published results, which contain the study's configuration.
    codecs
        Names of codecs, or places of the user's own (``path/to/file.py:Class``).
    results
        Folder of the results.
    datasets
        Names of the study's data sets to use; by default all.

    Returns
    -------
    dict[str, Any]
        The configuration, as it is written to a file.

    Raises
    ------
    InputError
        The study has no data set of a given name, its data are missing on this machine, a codec
        cannot encode any of the clouds, or the study's configuration is invalid or names code.
    """
    study = _stored(reference)
    offered: Mapping[str, Options] = study["datasets"]
    for name in datasets:
        if name not in offered:
            raise InputError(
                f"--datasets: {reference.name} has no data set '{name}'{among(name, list(offered))}"
            )
    selected = {
        name: {key: value for key, value in data.items() if key != "codecs"}
        for name, data in offered.items()
        if name in (datasets or offered)
    }
    used = {data["scene_set"] for data in selected.values()}
    shown = study["figures"].get("examples", {})
    examples = {kind: cloud for kind, cloud in shown.items() if cloud.split("/")[0] in selected}
    user_codecs = codec_entries(codecs)
    trust(entry.get("class") for entry in user_codecs.values())
    deltas = study["bd_rate"]
    if deltas.get("anchor") not in user_codecs:  # the anchor is then the first codec
        deltas = {key: value for key, value in deltas.items() if key != "anchor"}
    config = {
        **study,
        "scene_sets": {name: value for name, value in study["scene_sets"].items() if name in used},
        "datasets": selected,
        "drives": {},
        "thesis": False,
        "codecs": user_codecs,
        "bd_rate": deltas,
        "figures": {**study["figures"], "examples": examples},
        "report": {"title": f"{reference.title}: {', '.join(user_codecs)}"},
    }
    made = {"results": results, **_without_defaults(config)}
    check_codecs(Plan(checked(made)), advice=False)
    return made


def _stored(reference: ReferenceResults) -> Options:
    """Return the part of the study's stored configuration that defines clouds and metrics."""
    # A file of results must not run code, so a configuration that names code is refused.
    kept = {k: v for k, v in reference.about["configuration"].items() if k not in _NOT_KEPT}
    with naming(f"{reference.name}: the configuration of the study"):
        study = checked(kept)
        for place in study.places():
            raise InputError(f"names code, which results must not: {place!r}")
    return {key: value for key, value in study.as_json().items() if key not in _NOT_KEPT}


def _without_defaults(config: Options) -> Options:
    kept = checked(config).model_dump(mode="json", by_alias=True, exclude_defaults=True)
    return {**kept, "codecs": config["codecs"]}
