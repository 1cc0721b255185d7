# The checked configuration, the plan of what it asks for, and helpers of the rules.
import json
import os
import sys
from pathlib import Path

SOURCE = str(Path(workflow.basedir).parent / "src")
sys.path.insert(0, SOURCE)

from puckbench.codeversion import code_version
from puckbench.errors import InputError
from puckbench.figures.registry import FIGURES as REGISTRY
from puckbench.workflow import Workflow, hold_results, run_jobs_with

run_jobs_with(SOURCE)


def or_stop(step, *arguments):
    """The step's result; one line and exit status 2 when the user's input cannot be used."""
    try:
        return step(*arguments)
    except InputError as error:
        print(f"puckbench: {error}", file=sys.stderr, flush=True)
        os._exit(2)  # Snakemake would turn an exception into status 1 and a traceback


bench = or_stop(Workflow, config, Path(workflow.basedir) / "schemas" / "config.schema.yaml")
RESULTS = str(bench.plan.results)


onstart:
    or_stop(hold_results, bench.plan.results)


wildcard_constraints:
    scenes="|".join(bench.plan.scenes),
    dataset="|".join(bench.plan.datasets),
    codec="|".join(bench.plan.codecs),
    cloud=r"[A-Za-z0-9_.-]+",
    scene=r"[A-Za-z0-9_.-]+",
    rate=r"[A-Za-z0-9_]+",
    figure=r"[a-z0-9_]+",


def truth_arguments(input):
    """Options of `puckbench evaluate` for data sets whose true surface is known."""
    return " ".join(f"--{name} {input[name]}" for name in ("truth", "visible") if name in input.keys())
