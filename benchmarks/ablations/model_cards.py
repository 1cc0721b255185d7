"""Rate and distortion of the shipped weights on held-out clouds, written into their model cards.

    clouds=results/train/clouds
    snakemake $clouds/held_out_objects/{airplane,chair,gear,lamp,screw,vase}_01.ply \\
        $clouds/held_out_rooms/{hallway_2,meeting_room_1,office_1,storage_1}.ply \\
        --cores 2 --configfile config/train.yaml
    python -m benchmarks.ablations.model_cards [--sets pcgcv2_objects ...]

Each set is measured at its codec's rates on the data sets that `config/train.yaml` validates its
training on, as `puckbench train --validate` does. A card, the set's own and these means, is written
beside the set, as `puckbench train` writes it. Minutes for each set.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import yaml

from puckbench.codecs.registry import open_codec
from puckbench.core.files import write_json
from puckbench.io.clouds import read_cloud
from puckbench.jobs.validation import peak_of, validation
from puckbench.learned.catalogue import header_of, shipped
from puckbench.planning.workflow import Workflow

ROOT = Path(__file__).parents[2]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", nargs="+", default=sorted(shipped()), choices=sorted(shipped()))
    options = parser.parse_args()
    config = yaml.safe_load((ROOT / "config" / "train.yaml").read_text(encoding="utf-8"))
    workflow = Workflow(config, ROOT / "workflow" / "schemas" / "config.schema.yaml")
    for name in options.sets:
        path, plan = shipped()[name], workflow.training(name)
        codec = open_codec(plan.codec, {"options": {"weights": name}})
        files = [Path(file) for file in workflow.cloud_files(plan.validate)]
        clouds = [read_cloud(file) for file in files]
        found = validation(codec, clouds, peak_of(clouds))
        for rate, means in found["rates"].items():
            print(name, rate, {key: float(f"{value:.4g}") for key, value in means.items()})
        data = [f"{file.parent.name}/{file.name}" for file in files]
        card = {**header_of(path).card, "validation": {"data": data, **found}}
        write_json(path.with_suffix(".json"), card)


if __name__ == "__main__":
    main()
