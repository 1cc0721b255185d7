#!/bin/sh
# The small benchmark on a Slurm cluster of one node, this machine, against a local run: the same tables?
#   benchmarks/checks/slurm/run.sh [CONFIG]     from the repository's root, with .venv active, as root
# Needs Debian's slurm-wlm and munge, and `make slurm`. Exit status 1 when results differ.
set -eu
cd "$(dirname "$0")/../../.."
root=$(pwd -P)
config=$(realpath "${1:-benchmarks/small.yaml}")
python -c 'import snakemake_executor_plugin_slurm' 2>/dev/null || { echo 'run: make slurm first' >&2; exit 2; }
place=$(mktemp -d)
trap '"$root/benchmarks/checks/slurm/one_node.sh" stop "$place/cluster"; rm -rf "$place"' EXIT

run() { # folder, further arguments: the tables, made from nothing
    mkdir -p "$place/$1"
    (cd "$place/$1" && shift && snakemake --snakefile "$root/workflow/Snakefile" tables --quiet rules host reason \
        --configfile "$config" --config results=results "$@")
}

"$root/benchmarks/checks/slurm/one_node.sh" start "$place/cluster"
run local --cores 2
run slurm --profile "$root/workflow/profiles/slurm" --cores 2 --slurm-status-command squeue \
    --slurm-init-seconds-before-status-checks 5 --slurm-no-account
python benchmarks/same_results.py "$place/slurm/results" "$place/local/results"
