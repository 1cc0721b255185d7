from __future__ import annotations

import json
import os
import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from puckbench import __version__
from puckbench.core.environment import cpu_model, installed_versions
from puckbench.core.renamed_keys import with_new_keys
from puckbench.figures.binning import ordered_rates
from puckbench.figures.style import FigureStyle
from puckbench.metrics.lossless import LOSSLESS
from puckbench.metrics.peaks import peaks_of_datasets
from puckbench.results.columns import column_named
from puckbench.tables.cells import cell_text

if TYPE_CHECKING:
    import pandas as pd

_MAKES = {"sample": "sampled", "scan": "scanned", "cloud": "as captured"}
_KEYS = frozenset(["dataset", "cloud", "codec", "rate", "scene", "group", "digest", LOSSLESS])
_MOST_VALUES = 5


@dataclass(frozen=True)
class RunDescription:
    """What the page says about how a run was made.

    Parameters
    ----------
    datasets, codecs
        A row for each data set and each codec, as texts by heading.
    machine
        Facts about the machine and the software, by name.
    configuration
        The configuration as YAML, or empty.
    """

    datasets: tuple[Mapping[str, str], ...]
    codecs: tuple[Mapping[str, str], ...]
    machine: Mapping[str, str]
    configuration: str


def describe_run(
    configuration: Mapping[str, Any],
    metrics: pd.DataFrame | None,
    clouds: pd.DataFrame | None,
    machine: Mapping[str, str],
    style: FigureStyle,
) -> RunDescription:
    """Describe how a run was made.

    Parameters
    ----------
    configuration
        Configuration of the run.
    metrics, clouds
        Tables of the run: results and clouds; None if the run has none.
    machine
        Facts about the machine, by name.
    style
        Style of the figures, for titles.
    """
    configuration = with_new_keys(configuration)
    return RunDescription(
        datasets=tuple(_datasets(configuration, metrics, clouds, style)),
        codecs=() if metrics is None else tuple(_codecs(configuration, metrics, style)),
        machine={**machine, **({} if metrics is None else _measured_on(metrics))},
        configuration=_as_yaml(configuration) if configuration else "",
    )


def _datasets(
    configuration: Mapping[str, Any],
    metrics: pd.DataFrame | None,
    clouds: pd.DataFrame | None,
    style: FigureStyle,
) -> Iterable[dict[str, str]]:
    peaks = {} if metrics is None else peaks_of_datasets(metrics)
    for name, value in configuration.get("datasets", {}).items():
        scene_set = value["scene_set"]
        count, points = _sizes(clouds, name)
        yield {
            "Data set": style.title(name),
            "Name": name,
            "Scene set": f"{scene_set} ({configuration['scene_sets'][scene_set]['loader']})",
            "Clouds are": _MAKES[value["make"]],
            "Error model": value["errors"] if value["make"] == "scan" else "",
            "Clouds": count,
            "Points, median": points,
            "Peak of PSNRs": peaks.get(name, ""),
        }


def _sizes(clouds: pd.DataFrame | None, dataset: str) -> tuple[str, str]:
    if clouds is None:
        return "", ""
    points = clouds.loc[clouds["dataset"] == dataset, "points"]
    return str(len(points)), f"{points.median():,.0f}" if len(points) else ""


def _codecs(
    configuration: Mapping[str, Any], metrics: pd.DataFrame, style: FigureStyle
) -> Iterable[dict[str, str]]:
    entries = configuration.get("codecs", {})
    for name in style.ordered_codecs(metrics["codec"].unique()):
        rows = metrics[metrics["codec"] == name]
        changed = {key: value for key, value in (entries.get(name) or {}).items() if value}
        yield {
            "Codec": style.of_codec(name).title,
            "Name": name,
            "Version and weights": _versions(rows),
            "Rates": ", ".join(ordered_rates(set(rows["rate"]))),
            "Changed in the configuration": json.dumps(changed, sort_keys=True) if changed else "",
        }


def _versions(rows: pd.DataFrame) -> str:
    columns = [name for name in rows.select_dtypes(exclude="number") if _is_of_codec(str(name))]
    return "; ".join(text for name in columns for text in _distinct(rows[name])[:_MOST_VALUES])


def _measured_on(metrics: pd.DataFrame) -> dict[str, str]:
    texts = [str(n) for n in metrics.select_dtypes(exclude="number") if n not in _KEYS]
    values_by_column = {name: _distinct(metrics[name]) for name in texts if not _is_of_codec(name)}
    return {
        f"Results: {column_named(name).words.lower()}": ", ".join(values[:_MOST_VALUES])
        for name, values in values_by_column.items()
        if values
    }


def _is_of_codec(name: str) -> bool:
    return name == "codec_version" or "weights" in name


def _distinct(values: pd.Series[Any]) -> list[str]:
    return list(dict.fromkeys(cell_text(value) for value in values.dropna()))


def _as_yaml(configuration: Mapping[str, Any]) -> str:
    import yaml

    plain = json.loads(json.dumps(configuration))
    return str(yaml.safe_dump(plain, sort_keys=False, width=100))


def this_machine() -> dict[str, str]:
    """Return facts about this machine and the installed software, as texts by name."""
    versions = installed_versions()
    return {
        "puckbench": __version__,
        "Python": f"{platform.python_implementation()} {platform.python_version()}",
        "Libraries": ", ".join(f"{name} {version}" for name, version in versions.items()),
        "System": " ".join([platform.system(), platform.machine(), *platform.libc_ver()]).strip(),
        "Processor": f"{cpu_model()} ({os.cpu_count()} logical cores)",
    }
