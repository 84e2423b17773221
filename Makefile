# Everything from a fresh machine: needs Python >= 3.11 with venv and pip, and make.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install -q -c constraints.txt

# One thread per process: the tests run in two processes and the engines start their own threads.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Bytecode is kept, also where the environment (of a container, say) forbids it: the tests start hundreds of processes,
# and each would compile all modules that it imports, which takes Numba's alone two seconds.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo quick test test-generic test-busy test-lowest line-coverage coverage judge lint style format verify fuzz soak attack fleet disk kernels bench docs docs-images docs-notebooks clean

# Two processes; one that has nothing left to do takes over tests of the other, so that fixtures are seldom made twice.
PROCESSES := -m pytest -q -n 2 --dist worksteal
TESTS := $(PROCESSES) tests
# On a fresh machine the tests' kernels are compiled while pip waits for network and disk, which leaves a processor idle.
test: BESIDE := for p in f64 f32; do PYTHONPATH=src $(BIN)/python -m tools.compile_ahead $$p > $(VENV)/$$p.txt 2>&1 & done;
# Within a minute on two processors once kernels are compiled: no tests of processes, none of whole calibrations, none of
# all variants.
QUICK := $(addprefix tests/,base/test_live.py base/test_text.py physics data report verification workers plugins/maps \
    plugins/foreign_fmu plugins/stepper/test_stepper.py engine/test_metered.py calibration/test_study_file.py cli/test_simulate.py \
    cli/test_calibrate.py calibration/test_objective.py calibration/test_differential_evolution.py runs/test_run.py) \
    $(addprefix --ignore=tests/,verification/test_direct_acting.py plugins/paper/test_plates.py data/test_standard_errors.py \
    plugins/maps/test_map.py plugins/maps/test_sweep_verb.py physics/test_unread.py)
REQUIRED := import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"], sep="\n")
# Without whole simulations: as plain Python they take minutes.
PHYSICS_TESTS := tests/physics tests/test_dimensions.py --ignore=tests/physics/test_feed_pipe.py
LOWEST := .venv-lowest
PYTHON_LOWEST ?= python3.11

help: ## show this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 24

demo: $(VENV)/.runtime ## calibrate the cases paper and cri2-16, repeat the paper's study, write three reports to demo/
	$(BIN)/python -m tools.demo --out demo

# The types are checked beside the tests: alone it would leave a processor idle. What it finds is told after them.
define beside_types
@echo "$(BIN)/mypy & $(BIN)/python $(1)"; $(BIN)/mypy > $(VENV)/types.txt 2>&1 & types=$$!; \
    $(BIN)/python $(1); tests=$$?; \
    wait $$types || { echo "$(BIN)/mypy:"; cat $(VENV)/types.txt; exit 1; }; \
    exit $$tests
endef

quick: style ## lint, check types and imports, run a sixth of the tests
	$(call beside_types,$(PROCESSES) -m 'not slow and not process and not gpu' $(QUICK))

# The direction of imports is one of the tests.
test: $(VENV)/.dev format ## lint, check types and imports, run the tests
	$(call beside_types,$(TESTS))

test-generic: $(VENV)/.dev ## run the tests with kernels for any x86-64 processor, without wide registers
	NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES= $(BIN)/python $(TESTS)

test-busy: $(VENV)/.dev ## run the tests beside six processes that keep the machine busy
	$(BIN)/python -m tests.robustness.busy 6 $(BIN)/python $(TESTS)

test-lowest: ## run the tests with the lowest versions that pyproject.toml admits, on Python 3.11
	$(PYTHON_LOWEST) -m venv --clear $(LOWEST)
	$(PYTHON_LOWEST) tools/lowest.py > $(LOWEST)/lowest.txt
	$(LOWEST)/bin/python -m pip install -q -c $(LOWEST)/lowest.txt -e '.[dev]'
	$(LOWEST)/bin/python $(TESTS)

line-coverage: $(VENV)/.dev ## run the physics as plain Python and measure what the tests reach of it (at least 95 %)
	NUMBA_DISABLE_JIT=1 $(BIN)/coverage run -m pytest -q $(PHYSICS_TESTS)
	$(BIN)/coverage report

coverage: $(VENV)/.dev ## fit 400 virtual benches of each kind and count the stated intervals that hold the truth (an hour)
	$(BIN)/python -m studies.coverage
	$(BIN)/python -m studies.coverage_written

judge: $(VENV)/.dev ## calibrate studies that are right, wrong, and of foreign injectors, and count the titles (an hour)
	$(BIN)/python -m studies.judge_trial foreign runs/judged
	$(BIN)/python -m studies.judge_trial studies runs/judged

lint: style ## format, lint, types, direction of imports
	$(BIN)/mypy

style: format ## format, lint, direction of imports
	$(BIN)/lint-imports --no-logo

format: $(VENV)/.dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check

verify: $(VENV)/.dev line-coverage fuzz soak attack fleet disk ## check the claims: the verification study, the slow tests and all trials below
	$(BIN)/commonrail lab verify
	$(BIN)/python -m pytest -q tests -m slow

fuzz: $(VENV)/.dev ## feed 100,000 damaged files to every reader
	$(BIN)/python -m tests.robustness.fuzz 100000

soak: $(VENV)/.runtime ## kill the paper's study 200 times at random instants and resume it
	$(BIN)/python -m tests.robustness.soak 200

attack: $(VENV)/.dev ## attack files, folders, caches and workers as docs/reliability.md says; each held or fallen
	$(BIN)/python -m tests.robustness.attack

fleet: $(VENV)/.runtime ## calibrate a synthetic fleet of 200, killed once and restarted once
	$(BIN)/python -m tests.robustness.fleet_trial

disk: $(VENV)/.runtime ## calibrate on disks that are too small (skipped, status 77, without leave to mount)
	$(BIN)/python -m tests.robustness.no_room || test $$? -eq 77

kernels: $(VENV)/.runtime ## compile the simulations of the catalogue into libraries: later starts need no compiler
	$(BIN)/python -m tools.wheel_libraries

bench: $(VENV)/.bench ## time and accuracy beside peers, into benchmarks/results.json and docs/images/
	$(BIN)/python -m benchmarks speed --peers --out benchmarks/results.json
	$(BIN)/python -m benchmarks.roofline benchmarks/results.json
	$(BIN)/python -m benchmarks.plot benchmarks/results.json docs/images

docs: $(VENV)/.docs ## build the site of the documentation into site/; a warning is an error
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

docs-images: $(VENV)/.dev ## make the pictures of README and site by the present code (needs Chromium)
	$(BIN)/python -m tools.docs_images docs/images

docs-notebooks: $(VENV)/.dev ## run the notebooks of the site and keep their outputs
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/python -m tools.notebooks

clean: ## remove the environment, caches and build products
	rm -rf $(VENV) $(LOWEST) build dist demo site .cache .coverage .pytest_cache .mypy_cache .ruff_cache .hypothesis \
	    .import_linter_cache
	find src tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

# A stamp is older than what it was made from: the installation is repeated.
$(VENV)/.runtime: $(VENV)/.made pyproject.toml constraints.txt
	$(INSTALL) -e '.[plates]'
	@touch $@

# Of some 13,000 modules the tests import a tenth: these are compiled to bytecode as they are imported. Of all files 40 %
# are ziglang's, which requires nothing: it is installed beside what simulates, the rest when both are there. Coverage is
# there by then because Numba imports it where it finds it, whole or not.
$(VENV)/.dev: $(VENV)/.made pyproject.toml constraints.txt
	@$(BIN)/python -c '$(REQUIRED)' > $(VENV)/required.txt
	$(INSTALL) --no-compile --no-deps ziglang coverage & zig=$$!; \
	    $(INSTALL) --no-compile -r $(VENV)/required.txt && wait $$zig
	$(BESIDE) $(INSTALL) --no-compile -e '.[dev]'
	@touch $@ $(VENV)/.runtime

$(VENV)/.bench: $(VENV)/.made pyproject.toml constraints.txt
	$(INSTALL) -e '.[bench]'
	@touch $@ $(VENV)/.runtime

$(VENV)/.docs: $(VENV)/.made pyproject.toml constraints.txt
	$(INSTALL) -e '.[docs]'
	@touch $@ $(VENV)/.runtime

$(VENV)/.made:
	@command -v $(PYTHON) >/dev/null || { \
	    echo "make: $(PYTHON) was not found; install Python 3.11 or newer, or name one:" \
	        "make PYTHON=/path/to/python3 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	    echo "make: Python 3.11 or newer is needed and $(PYTHON) is" \
	        "$$($(PYTHON) -V 2>&1); name a newer one: make PYTHON=python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	    echo "make: $(PYTHON) lacks its venv module; install it" \
	        "(on Debian and Ubuntu: apt install python3-venv)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@
