# The checked configuration, its plan, and helper functions of the rules.
import gc
import os
import shlex
import sys
from pathlib import Path

# The folder of this workflow, also if another workflow uses it as a module. A workflow that Snakemake
# fetched from a repository has no folder; then the installed package is used.
FOLDER = Path(workflow.current_basedir.get_path_or_uri(secret_free=True)).parent
SOURCE = FOLDER.parent / "src"
if SOURCE.is_dir():
    sys.path.insert(0, str(SOURCE))

from puckbench.core.interrupts import interrupt_with_run
from puckbench.core.packages import packages_alone
from puckbench.core.renamed_keys import renaming_line
from puckbench.figures.registry import figure_entry
from puckbench.tables.registry import table_entry
from puckbench.planning.config import check_config_files
from puckbench.planning.failures import failed_jobs, failure_lines, write_failures
from puckbench.planning.launch import AGAIN, CALLER_GOES_ON, command_for_the_rest
from puckbench.planning.provenance import Provenance
from puckbench.planning.rules import Rules, or_stop
from puckbench.planning.run_summary import closing_lines
from puckbench.planning.run_time import job_seconds
from puckbench.planning.running import (
    held_since,
    hold_results,
    left_out_lines,
    mark_planning,
)
from puckbench.planning.workflow import Workflow, run_jobs_with
from puckbench.steps.fork_server import LEARNED, MODULES, start_fork_server
from puckbench.steps.process import TIMEOUT
from puckbench.steps.step import words_of
from snakemake_logger_plugin_puckbench import BARS

if not SOURCE.is_dir() and workflow.deployment_settings.deployment_method:
    # Environments that Snakemake deploys have every package but puckbench.
    SOURCE = packages_alone(Path(".snakemake", "packages"))
run_jobs_with(str(SOURCE) if SOURCE.is_dir() else "")
# Planning makes millions of objects that are not freed, so garbage collection is rare.
gc.set_threshold(100_000, 50, 100)


def end_bars():
    for bar in BARS:
        bar.close()


def one_of(names):
    """Return a pattern that matches exactly these names."""
    return "|".join(names) or "(?!)"


def priority_of(wildcards):
    """Prefer the jobs that the rule `first_look` waits for, then those that make clouds."""
    places = flow.outputs.first_places
    if all(wildcards[key] in places[key] for key in wildcards.keys() & places.keys()):
        return 2
    return int("codec" not in wildcards.keys())


if workflow.is_main_process:
    interrupt_with_run()
    # Snakemake reads YAML 1.1, and of repeated keys the last.
    or_stop(check_config_files, workflow.configfiles)
    if line := or_stop(renaming_line, config):
        print(f"puckbench: {line}", file=sys.stderr, flush=True)
    or_stop(mark_planning)
flow = or_stop(Workflow, config, True)
plan = flow.plan
RESULTS = str(plan.results)
# Prefix of the command of a timed job, which limits the threads of libraries.
TIMED = shlex.join(["env", *map("=".join, flow.costs.threads_environment.items())])
# Not workflow.cores, which is an error without a run (--report).
CORES = workflow.resource_settings.cores
# In the environment, not in the settings of steps, since it changes no result.
os.environ[TIMEOUT] = str(plan.config.timing.timeout_s or "")


provenance = None  # if Snakemake alone knows it
# Each job on a cluster reads this file again. Logs in a remote store cannot be read while planning.
if workflow.is_main_process and workflow.storage_settings.default_storage_provider is None:
    provenance = Provenance(plan.results)
    if provenance.is_lost:
        line = f"puckbench: {RESULTS}: no log says how results were made: all are made again"
        print(line, file=sys.stderr, flush=True)
rules_of = Rules(
    flow,
    provenance,
    ancient,
    local,
    has_begun=not workflow.is_main_process,
    again=os.environ.get(AGAIN, "").split() if workflow.is_main_process else (),
)
for bar in BARS:  # with --logger puckbench, as `puckbench run` has it
    bar.expect(
        job_s=job_seconds(flow),
        cores=CORES or 1,
        notes={"first_look": f"the first figures are in {RESULTS}/first_look"},
    )


onstart:
    or_stop(hold_results, plan.results)
    or_stop(rules_of.begin)
    if not plan.config.failed:
        plan.config.failures_file.unlink(missing_ok=True)
        # The run that failed has printed them already.
        for line in left_out_lines(flow.outputs.left_out_rows):
            print(f"puckbench: {line}", file=sys.stderr, flush=True)
    if workflow.local_exec:
        # Cores are the limit here. With a limit of jobs a second, each job that ends adds a timer
        # that considers all ready jobs again, each second, until the run ends (Snakemake 9.27).
        workflow.scheduler.job_rate_limiter = None
    if workflow.local_exec and not workflow.deployment_settings.deployment_method:
        # For jobs that run on this machine and in this environment.
        learned = LEARNED if any(plan.weights.values()) else ()
        start_fork_server(plan.config.timing.threads, (*MODULES, *learned))


onsuccess:
    end_bars()
    if CALLER_GOES_ON not in os.environ:
        made = flow.outputs
        tables = (*made.gathered, *made.tables)
        for line in closing_lines(plan.results, made.titles, made.anchor, held_since(), tables):
            print(line, flush=True)
        for line in left_out_lines(flow.outputs.left_out_rows):
            print(line, flush=True)


onerror:
    end_bars()
    failed = failed_jobs(plan.results / "logs", held_since())
    if not BARS:  # which print each failure at once
        for line in failure_lines(failed):
            print(line, file=sys.stderr, flush=True)
    rest = write_failures(plan.config.failures_file, failed, plan.config.failed)
    if rest and CALLER_GOES_ON not in os.environ:
        start = None if workflow.overwrite_workdir else Path(workflow.workdir_init)
        files = [*map(Path, workflow.configfiles), rest]
        line = command_for_the_rest(sys.argv[1:], files, start)
        print(f"puckbench: tables and report without them: {line}", file=sys.stderr, flush=True)


# Only with --software-deployment-method apptainer (envs/apptainer.def makes the image).
container: plan.config.container


wildcard_constraints:
    scene_set=one_of(plan.scene_sets),
    drives=one_of(flow.drives.entries),
    drive=r"[A-Za-z0-9_.-]+",
    dataset=one_of(plan.datasets),
    codec=one_of(plan.codecs),
    trained=one_of(plan.trainings),
    network=one_of(plan.segmentations),
    model=one_of(plan.study.models if plan.study else ()),
    capture=one_of(plan.study.captures if plan.study else ()),
    cloud=r"[A-Za-z0-9_.-]+",
    scene=r"[A-Za-z0-9_.-]+",
    figure=r"[a-z0-9_]+",
    rate=r"[A-Za-z0-9_.-]+",
