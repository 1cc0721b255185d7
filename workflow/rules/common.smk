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

from pointkit.errors import InputError
from pointkit.files import refusing_paths
from puckbench.core.interrupts import interrupt_with_run
from puckbench.figures.registry import figure_entry
from puckbench.jobs.fork_server import LEARNED, MODULES, start_fork_server
from puckbench.core.packages import packages_alone
from puckbench.jobs.process import TIMEOUT
from puckbench.tables.registry import table_entry
from puckbench.planning.config import check_config_files
from puckbench.planning.failures import failed_jobs, failure_lines, write_failures
from puckbench.planning.launch import CALLER_GOES_ON, command_for_the_rest
from puckbench.planning.provenance import OTHERWISE, Provenance, time_of_planning, write_otherwise
from puckbench.planning.run_summary import closing_lines
from puckbench.planning.run_time import job_seconds
from puckbench.planning.running import (
    check_records,
    held_since,
    hold_results,
    left_out_lines,
)
from puckbench.planning.workflow import Workflow, run_jobs_with
from snakemake_logger_plugin_puckbench import BARS

if not SOURCE.is_dir() and workflow.deployment_settings.deployment_method:
    # Environments that Snakemake deploys have every package but puckbench.
    SOURCE = packages_alone(Path(".snakemake", "packages"))
run_jobs_with(str(SOURCE) if SOURCE.is_dir() else "")
# Planning makes millions of objects that are not freed, so garbage collection is rare.
gc.set_threshold(100_000, 50, 100)


def or_stop(step, *arguments):
    """Call a function; on bad input, print one line and exit with status 2."""
    try:
        with refusing_paths():
            return step(*arguments)
    except InputError as error:
        print(f"puckbench: {error}", file=sys.stderr, flush=True)
        os._exit(2)  # Snakemake would turn an exception into status 1 and a traceback


def end_bars():
    for bar in BARS:
        bar.close()


def one_of(names):
    """Return a pattern that matches exactly these names."""
    return "|".join(names) or "(?!)"


def files_of(files, names):
    """Return words `key=FILE ...` for the inputs of these names."""
    return shlex.join(f"{name}={files[name]}" for name in names)


def planned(function):
    """Return a function of wildcards that stops with one line if the plan has no such result."""

    def checked(wildcards):
        or_stop(bench.check_names, dict(wildcards.items()))
        return or_stop(function, wildcards)

    return checked


def record_of(job):
    """Return a parameter: the file of a job's settings, whose name is a digest of them."""
    return planned(lambda wildcards: job(wildcards).file())


def code_of(job):
    """Return a parameter: the fingerprint of a job's code."""
    return lambda wildcards: job(wildcards).code


def made_by(log, job):
    """Return an input, newer than the results if their log does not name the job's settings and code."""

    def otherwise(wildcards):
        path = f"{RESULTS}/logs/{log}.log".format(**wildcards)
        try:  # a job that the plan lacks is told of when it starts, or by its other inputs
            bench.check_names(dict(wildcards.items()))
        except InputError:
            return local(str(OTHERWISE))
        if provenance is None or provenance.is_made_by(path, job(wildcards)):
            return local(ancient(str(OTHERWISE)))
        return local(str(OTHERWISE))

    return otherwise


def by_content(files):
    """Return inputs whose times do not count, since fingerprints of jobs include their content."""
    return {name: ancient(paths) for name, paths in files.items()}


def priority_of(wildcards):
    """Prefer curves of the first codec, which the rule `first_look` shows."""
    return 1 if wildcards.codec == outputs.first_codec else 0


def curve_of(wildcards):
    """Return data set, cloud and codec of a curve."""
    return wildcards.dataset, wildcards.cloud, wildcards.codec


if workflow.is_main_process:
    interrupt_with_run()
    # Snakemake reads YAML 1.1, and of repeated keys the last.
    or_stop(check_config_files, workflow.configfiles)
    or_stop(check_records)
PLANNED_AT = or_stop(time_of_planning, Path(".snakemake"))
bench = or_stop(Workflow, config, True)
plan, clouds, coding, drives = bench.plan, bench.clouds, bench.coding, bench.drives
study, training, outputs = bench.study, bench.training, bench.outputs
RESULTS = str(plan.results)
# Prefix of the command of a timed job, which limits the threads of libraries.
TIMED = shlex.join(["env", *map("=".join, coding.threads_environment.items())])
# Not workflow.cores, which is an error without a run (--report).
CORES = workflow.resource_settings.cores
# In the environment, not in the records of jobs, since it changes no result.
os.environ[TIMEOUT] = str(bench.config.timing.timeout_s or "")


provenance = None  # if Snakemake alone knows it
if workflow.is_main_process:  # each job on a cluster reads this file again
    # Logs in a remote store cannot be read while planning.
    if workflow.storage_settings.default_storage_provider is None:
        provenance = Provenance(plan.results)
        if provenance.is_lost():
            line = f"puckbench: {RESULTS}: no log says how results were made: all are made again"
            print(line, file=sys.stderr, flush=True)
if workflow.is_main_process or not OTHERWISE.exists():
    write_otherwise(PLANNED_AT)
for bar in BARS:  # with --logger puckbench, as `puckbench run` has it
    bar.expect(
        job_s=job_seconds(bench),
        cores=CORES or 1,
        notes={"first_look": f"the first figures are in {RESULTS}/first_look"},
    )


onstart:
    or_stop(hold_results, plan.results)
    if not plan.config.failed:
        plan.config.failures_file.unlink(missing_ok=True)
    if not plan.config.failed:  # else the run that failed has printed them
        for line in left_out_lines(outputs.left_out_rows):
            print(f"puckbench: {line}", file=sys.stderr, flush=True)
    if workflow.local_exec and not workflow.deployment_settings.deployment_method:
        # For jobs that run on this machine and in this environment.
        learned = LEARNED if any(plan.weights.values()) else ()
        start_fork_server(coding.timing.threads, (*MODULES, *learned))


onsuccess:
    end_bars()
    if CALLER_GOES_ON not in os.environ:
        tables = (*outputs.gathered, *outputs.tables)
        for line in closing_lines(plan.results, outputs.titles, outputs.anchor, held_since(), tables):
            print(line, flush=True)
        for line in left_out_lines(outputs.left_out_rows):
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
container: bench.config.container


wildcard_constraints:
    scenes=one_of(plan.scenes),
    drives=one_of(drives.entries),
    drive=r"[A-Za-z0-9_.-]+",
    dataset=one_of(plan.datasets),
    codec=one_of(plan.codecs),
    trained=one_of(plan.trainings),
    model=one_of(plan.study.models if plan.study else ()),
    capture=one_of(plan.study.captures if plan.study else ()),
    cloud=r"[A-Za-z0-9_.-]+",
    scene=r"[A-Za-z0-9_.-]+",
    figure=r"[a-z0-9_]+",
    rate=r"[A-Za-z0-9_.-]+",
