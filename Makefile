# make run    set up .venv, run the default benchmark, write its report
# make test   set up .venv with the test tools, then run every check; PACKAGE=gpcc checks one package of src/
# make lint   only the static checks         make data      fetch the free real data into data/
# make alone  install each package in an environment of its own, and use it there; takes minutes and gigabytes
# make fuzz   damaged streams and files for decoders and readers, for SECONDS=300 in all; fails on a crash, hang or blow-up
# make mutants  small changes of the code, which tests have to notice (MODULES=puckbench/metrics/density)
# make docs   build the documentation into site/, with the reference results (also: make site)
# make measure  time and memory of everything in benchmarks/performance, beside rivals, and the page of it: an hour;
#             SUBJECTS="puck scans" TMC3=/path/to/tmc3 PC_ERROR=/path/to/pc_error RECORDINGS="a.pcap b.db3"
# make pages  the documentation's pictures and numbers, from the reference results and the default run's clouds
# make reference STUDY=default   run a study, if need be, and keep its results as reference results;
#             with MORE=config/sweeps_reno.yaml laid over it, under that file's name
# make setup  .venv without torch            make learned   add torch and odometry, which a run needs
# make slurm  add what runs on a Slurm cluster need
# make lock   re-make the pins (LOCK=--upgrade for the newest of everything; needs uv)
# make dist   the wheels of all packages, into dist/
# make clean  remove results and caches, keep .venv and data/
# CORES=4 runs on more cores; PYTHON=python3.12 names the interpreter that .venv is made with.

CORES ?= 2
BIN := $(CURDIR)/.venv/bin
IN_VENV := PATH="$(BIN):$$PATH"

# Hundreds of processes import the same modules.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run test lint alone fuzz mutants measure setup setup-test learned slurm docs site pages reference data lock dist clean
.NOTPARALLEL:

run: learned
	$(IN_VENV) snakemake --cores $(CORES) --logger puckbench

setup:
	@envs/setup.sh

setup-test:
	@envs/setup.sh test learned odometry docs

learned:
	@envs/setup.sh learned odometry

slurm:
	@envs/setup.sh slurm

SOURCE = $(PACKAGE:%=src/%)
TESTS = $(PACKAGE:%=tests/%)

test: lint
	$(IN_VENV) pytest -n 2 --dist loadfile $(TESTS)

lint: setup-test
	$(IN_VENV) ruff check $(SOURCE) $(TESTS)
	$(IN_VENV) ruff format --check $(SOURCE) $(TESTS)
	$(IN_VENV) mypy $(SOURCE)
	$(IN_VENV) lint-imports --no-cache

alone: setup-test
	$(IN_VENV) pytest -m alone --durations 0 tests/repository/project/test_alone.py

SECONDS ?= 300
fuzz: setup-test
	$(IN_VENV) python -m benchmarks.checks.fuzz --seconds $(SECONDS) --keep fuzz

mutants: setup-test
	$(IN_VENV) python -m benchmarks.checks.mutants $(MODULES)

measure: learned
	$(IN_VENV) python -m benchmarks.performance.measure $(SUBJECTS) $(TMC3:%=--tmc3 %) $(PC_ERROR:%=--pc-error %) \
		$(if $(RECORDINGS),--recordings $(RECORDINGS)); status=$$?; \
	$(BIN)/python docs/extensions/shipped_numbers.py && exit $$status

docs: setup-test
	$(IN_VENV) sphinx-build -W --keep-going -q docs site
	@echo "Documentation: site/index.html"

site: docs

pages: learned
	$(IN_VENV) snakemake --cores $(CORES) results/figures/fig_6_3.png
	$(BIN)/python docs/extensions/pictures.py
	$(BIN)/python docs/extensions/shipped_numbers.py

STUDY ?= default
STUDY_CONFIG = config/$(STUDY:default=config).yaml
STUDY_RESULTS = $(if $(filter default,$(STUDY)),results,results/$(STUDY))
STUDY_FOLDER = $(if $(filter drives,$(STUDY)),reference_drives,reference)
STUDY_NAME = $(notdir $(basename $(lastword $(STUDY) $(MORE))))
reference: learned
	$(IN_VENV) snakemake --cores $(CORES) --configfile $(STUDY_CONFIG) $(MORE) -- reference
	cp $(STUDY_RESULTS)/reference.parquet src/puckbench/report/$(STUDY_FOLDER)/$(STUDY_NAME).parquet

data: setup
	$(IN_VENV) python -m puckbench data

lock: setup
	@command -v uv >/dev/null || { echo 'make lock needs uv on PATH (pip install uv)' >&2; exit 2; }
	$(BIN)/python envs/lock.py $(LOCK)

dist: setup
	rm -rf build dist
	$(BIN)/python -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist $(dir $(wildcard ./src/*/pyproject.toml))
	@ls -l dist

clean:
	rm -rf build results fuzz site jupyter_execute .snakemake .pytest_cache .mypy_cache .ruff_cache .hypothesis
