"""One job of many input files: more than a command line can hold."""

import json
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

from puckbench.jobs.process import leave, run_job

if TYPE_CHECKING:
    snakemake: Any = None

files = {
    name: [Path(path) for path in ([paths] if isinstance(paths, str) else paths)]
    for part in (snakemake.input, snakemake.output)
    for name, paths in part.items()
}
with Path(snakemake.log[0]).open("w", encoding="utf-8") as log, redirect_stdout(log):
    run_job(snakemake.params.job, json.loads(snakemake.params.record), files)
leave(0)
