# The checked configuration, the plan of what it asks for, and helpers of the rules.
import gc
import os
import shlex
import sys
from pathlib import Path

# Here lies this workflow, also where another one uses it as a module. Fetched from a repository it
# lies in no folder: then the installed package serves.
FOLDER = Path(workflow.current_basedir.get_path_or_uri(secret_free=True)).parent
SOURCE = FOLDER.parent / "src"
if SOURCE.is_dir():
    sys.path.insert(0, str(SOURCE))

from puckbench.core.errors import InputError
from puckbench.jobs.fork_server import LEARNED, MODULES, start_fork_server
from puckbench.jobs.process import TIMEOUT
from puckbench.planning.config import check_config_files
from puckbench.planning.failures import failed_jobs, failure_lines, write_failures
from puckbench.planning.launch import TOLD_BY_CALLER
from puckbench.planning.planned_job import results_folder
from puckbench.planning.run_summary import closing_lines
from puckbench.planning.run_time import (
    compiling_seconds,
    job_seconds,
    machine_sample,
    run_seconds,
)
from puckbench.planning.running import (
    check_room,
    hold_results,
    left_out_lines,
    now,
)
from puckbench.planning.workflow import Workflow, package_alone, run_jobs_with
from snakemake_logger_plugin_puckbench import BARS

if not SOURCE.is_dir() and workflow.deployment_settings.deployment_method:
    # An environment that Snakemake deploys has every package but puckbench.
    SOURCE = package_alone(Path(".snakemake", "packages"))
run_jobs_with(str(SOURCE) if SOURCE.is_dir() else "")
# Planning makes millions of objects that stay; Python need not look through them again and again.
gc.set_threshold(100_000, 50, 100)


def or_stop(step, *arguments):
    """The step's result; one line and exit status 2 when the user's input cannot be used."""
    try:
        return step(*arguments)
    except InputError as error:
        print(f"puckbench: {error}", file=sys.stderr, flush=True)
        os._exit(2)  # Snakemake would turn an exception into status 1 and a traceback


def end_bars():
    """Leave the terminal to what comes after the bar."""
    for bar in BARS:
        bar.close()


def one_of(names):
    """A pattern of exactly these names; of none, where there are none."""
    return "|".join(names) or "(?!)"


def files_of(files, names):
    """Words `key=FILE ...` of those inputs of a job that have these names."""
    return shlex.join(f"{name}={files[name]}" for name in names)


def folder_of(files, gathering):
    """The results folder in which a job finds the files that it gathers."""
    return results_folder(files, gathering.names, plan.results)


def record_of(job):
    """The file of a job's settings, for a parameter: its name changes with its content."""
    return lambda wildcards: job(wildcards).file()


def code_of(job):
    """The fingerprint of a job's code, for a parameter."""
    return lambda wildcards: job(wildcards).code


def priority_of(wildcards):
    """Clouds come before curves, and curves of the first codec before others: see `first_look`."""
    return 1 if wildcards.codec == outputs.first_codec else 0


def curve_of(wildcards):
    """Data set, cloud, codec and part of a curve's job; no part where the job has all rates."""
    return wildcards.dataset, wildcards.cloud, wildcards.codec, wildcards.get("part", "")


if workflow.is_main_process:
    # Snakemake reads YAML 1.1, and takes the last of keys that are there twice.
    or_stop(check_config_files, workflow.configfiles)
bench = or_stop(Workflow, config, True)
plan, clouds, coding = bench.plan, bench.clouds, bench.coding
study, training, outputs = bench.study, bench.training, bench.outputs
RESULTS = str(plan.results)
# What goes before the command of a timed job: the threads that libraries may use.
TIMED = shlex.join(["env", *map("=".join, coding.threads_environment.items())])
# Not workflow.cores, an error where nothing runs (--report).
CORES = workflow.resource_settings.cores
# For all jobs: it changes no result, so it is no part of their records.
os.environ[TIMEOUT] = str(bench.config.timing.timeout_s or "")


if workflow.is_main_process:  # of a cluster's jobs each reads this file again
    # Where Snakemake keeps its records; without room there it would end in a traceback.
    or_stop(check_room, Path(".snakemake"))
BEGUN = now()
for bar in BARS:  # with --logger puckbench, as `puckbench run` has it
    work_of = job_seconds(bench)
    here = (CORES or 1, machine_sample(), compiling_seconds(bench))
    bar.expect(
        job_s=work_of,
        run_s=lambda jobs: run_seconds(jobs, work_of, *here),
        cores=CORES or 1,
        notes={"first_look": f"the first figures are in {RESULTS}/first_look"},
    )


onstart:
    or_stop(hold_results, plan.results)
    if not plan.config.failed:
        plan.config.failures_file.unlink(missing_ok=True)
    for line in left_out_lines(plan.left_out_rows()):
        print(f"puckbench: {line}", file=sys.stderr, flush=True)
    if workflow.local_exec and not workflow.deployment_settings.deployment_method:
        # For jobs that run on this machine and in this environment.
        learned = LEARNED if any(plan.weights.values()) else ()
        start_fork_server(coding.timing.threads, (*MODULES, *learned))


onsuccess:
    end_bars()
    if TOLD_BY_CALLER not in os.environ:
        for line in closing_lines(plan.results, outputs.titles, outputs.anchor, BEGUN):
            print(line, flush=True)
        for line in left_out_lines(plan.left_out_rows()):
            print(line, flush=True)


onerror:
    end_bars()
    failed = failed_jobs(plan.results / "logs", BEGUN)
    for line in failure_lines(failed):
        print(line, file=sys.stderr, flush=True)
    rest = write_failures(plan.config.failures_file, failed)
    if rest and TOLD_BY_CALLER not in os.environ:
        files = shlex.join(map(str, [*workflow.configfiles, rest]))
        line = f"tables and report without them: snakemake --configfile {files} --cores {CORES}"
        print(f"puckbench: {line}", file=sys.stderr, flush=True)


# Only with --software-deployment-method apptainer (envs/apptainer.def makes the image).
container: bench.config.container


wildcard_constraints:
    scenes=one_of(plan.scenes),
    dataset=one_of(plan.datasets),
    codec=one_of(plan.codecs),
    trained=one_of(plan.trainings),
    model=one_of(plan.study.models if plan.study else ()),
    capture=one_of(plan.study.captures if plan.study else ()),
    cloud=r"[A-Za-z0-9_.-]+",
    scene=r"[A-Za-z0-9_.-]+",
    figure=r"[a-z0-9_]+",
    part=r"[A-Za-z0-9_.-]+",
    rate=r"[A-Za-z0-9_.-]+",
