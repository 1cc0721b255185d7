"""What the shipped sets of weights do on clouds that they did not learn from, into their cards.

    clouds=results/train/clouds
    snakemake $clouds/held_out_objects/{airplane,chair,gear,lamp,screw,vase}_01.ply \\
        $clouds/held_out_rooms/{hallway_2,meeting_room_1,office_1,storage_1}.ply \\
        --cores 2 --configfile config/train.yaml
    python benchmarks/model_cards.py $clouds [--sets pcgcv2_objects ...]

Each set is measured at its codec's rates on the data sets that `config/train.yaml` validates its
training on, as `puckbench train --validate` does. A card, the set's own and these means, is written
beside the set, as `puckbench train` writes it. Minutes for each set.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import yaml

from puckbench.cloud import read_cloud
from puckbench.codecs.learned.catalogue import header_of, shipped
from puckbench.codecs.learned.validation import faults, validated
from puckbench.codecs.registry import open_codec
from puckbench.files import write_json

TRAININGS = Path(__file__).parents[1] / "config" / "train.yaml"
PEAK = 1023.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clouds", type=Path)
    parser.add_argument("--sets", nargs="+", default=sorted(shipped()), choices=sorted(shipped()))
    options = parser.parse_args()
    trainings = yaml.safe_load(TRAININGS.read_text())["train"]
    for name in options.sets:
        path = shipped()[name]
        measured = validation(name, trainings[name], options.clouds)
        write_json(path.with_suffix(".json"), {**header_of(path)["card"], "validation": measured})


def validation(name: str, training: dict[str, Any], clouds: Path) -> dict[str, Any]:
    paths = [path for data in training["validate"] for path in sorted(clouds.glob(f"{data}/*.ply"))]
    codec = open_codec(training["codec"], {"options": {"weights": name}})
    found = validated(codec, [read_cloud(path) for path in paths], PEAK)
    for rate, means in found.items():
        print(name, rate, {key: float(f"{value:.4g}") for key, value in means.items()}, flush=True)
    data = [f"{path.parent.name}/{path.name}" for path in paths]
    return {"data": data, "rates": found, "faults": faults(found)}


if __name__ == "__main__":
    main()
