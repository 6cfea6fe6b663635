# SPDX-License-Identifier: Apache-2.0
# `make sil` and `make test` need only Python and make; everything else is installed into .venv. `make test-guest` and
# `make test-service` also need a few Debian packages, which they install as root or name.

PYTHON ?= python3
WORKERS ?= auto
TEST_ARGS ?=
GUEST_ARGS ?=
SERVICE_ARGS ?=
CLAIMS_ARGS ?=
FAULTS_ARGS ?=
KILLS_ARGS ?=
REALTIME_ARGS ?=
ENDURANCE_S ?= 600
FUZZ_S ?= 20
BENCH_SLICES ?= 3
ROBOT ?= uslgo1
SCENARIO_uslgo1 := circle-6cm
SCENARIO_4ws4wd := straight
SCENARIO ?= $(SCENARIO_$(ROBOT))
BIN := .venv/bin
STAMP := .venv/.installed
WHEELS := .venv/wheels
SERVICE_ENVIRONMENT := HYPOTHESIS_PROFILE=ci PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1
SERVICE_OPTIONS := -p no:cacheprovider --timeout 1800

# One thread per linear-algebra call: more are slower at these sizes, and not reproducible.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1
export MKL_NUM_THREADS := 1

.PHONY: sil venv test test-guest test-service lint fuzz claims faults faults-live kills endurance realtime bench clean
.DEFAULT_GOAL := sil

sil: venv  ## Walk USLGO1 round the 6 cm circle, or with ROBOT=4ws4wd drive the vehicle from beside a line onto it.
	@test -d .venv/kernels || echo "Translating the control loops to machine code first: once, a minute or two."
	$(BIN)/ugv sil $(ROBOT) $(SCENARIO)

venv: $(STAMP)  ## Create .venv with everything in it.

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' || \
	    { echo "$(PYTHON) is not a Python from 3.10 to 3.13: choose another one with 'make PYTHON=python3.12'." >&2; exit 2; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	    { echo "$(PYTHON) cannot create environments since it lacks ensurepip: on Debian and Ubuntu run 'sudo apt install python3-venv', then make again." >&2; exit 2; }
	@$(BIN)/python -m pip --version >/dev/null 2>&1 || $(PYTHON) -m venv --clear .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $(STAMP)

test: venv  ## Run all tests but those that need a kernel with CAN, or a systemd.
	$(BIN)/pytest -n $(WORKERS) --dist loadgroup $(TEST_ARGS)

test-guest: venv  ## Test drivers and faults on CAN interfaces of a kernel: of this one if it has CAN, else of a guest.
	@test -d .venv/kernels || { echo "Translating the control loops to machine code first: a guest would take long."; \
	    out="$$(mktemp -d)" && $(BIN)/ugv sil uslgo1 straight-1 --out "$$out/run" >/dev/null && rm -rf "$$out"; }
	tests/guest/with-can $(BIN)/pytest -p no:cacheprovider tests/guest $(GUEST_ARGS)

test-service: venv $(WHEELS)/.complete  ## Install into a real systemd in a container and test the units (needs root).
	PYTHON=$(BIN)/python tests/service/in-systemd env $(SERVICE_ENVIRONMENT) UGV_SERVICE_WHEELS=$(abspath $(WHEELS)) \
	    $(BIN)/python -m pytest $(SERVICE_OPTIONS) tests/service $(SERVICE_ARGS)
	PYTHON=$(BIN)/python tests/service/with-limits tests/service/in-systemd env $(SERVICE_ENVIRONMENT) \
	    UGV_SERVICE_UNITS_ONLY=1 $(BIN)/python -m pytest $(SERVICE_OPTIONS) -k "limits or families" tests/service/test_units.py

$(WHEELS)/.complete: pyproject.toml constraints.txt
	rm -rf $(WHEELS)
	$(BIN)/python -m pip download --quiet --disable-pip-version-check -d $(WHEELS) -c constraints.txt . \
	    "$$(sed -n 's/^requires = \["\(.*\)"\]/\1/p' pyproject.toml)"
	@rm -f $(WHEELS)/ugv_runtime-*
	@touch $@

lint: venv  ## Check style, types and import rules.
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

fuzz: venv  ## Try to break every decoder, FUZZ_S seconds each (needs x86_64: atheris).
	@$(BIN)/python -c 'import atheris' 2>/dev/null || \
	    $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[fuzz]'
	$(BIN)/python tests/fuzz/campaign.py --seconds $(FUZZ_S)

faults: venv  ## Break everything that can break in virtual time, of each robot under way, at several times.
	$(BIN)/ugv experiment faults $(FAULTS_ARGS)

faults-live: venv  ## Break wires, processes, network and disk of a robot that walks in real time.
	$(BIN)/ugv experiment faults --realtime $(FAULTS_ARGS)

claims: venv  ## Walk the scenarios on a few seeds and compare with what is claimed.
	$(BIN)/python tests/claims.py $(CLAIMS_ARGS)

kills: venv  ## Kill each process of a robot that walks in real time, again and again.
	$(BIN)/python tests/campaigns/kills.py $(KILLS_ARGS)

endurance: venv  ## Walk in real time for ENDURANCE_S seconds, lap after lap, and replay the log.
	out="$$(mktemp -d)" && trap 'rm -rf "$$out"' EXIT && \
	    $(BIN)/ugv sil uslgo1 circle-6cm --realtime --duration $(ENDURANCE_S) --out "$$out" && $(BIN)/ugv replay "$$out"

realtime: venv  ## Run scenarios in real time, and compare their figures with the spread of those in lockstep.
	$(BIN)/ugv experiment realtime --robot $(ROBOT) $(REALTIME_ARGS)

bench: venv  ## Measure, each figure beside what it is compared with; real time in BENCH_SLICES slices, six minutes of three.
	$(BIN)/ugv bench fuzzy
	$(BIN)/ugv bench mpc
	$(BIN)/ugv bench wbc
	$(BIN)/ugv bench tracker
	$(BIN)/ugv bench sil
	$(BIN)/ugv bench rt --slices $(BENCH_SLICES)

clean:  ## Remove the environment, caches and built packages; runs/ stays.
	rm -rf .venv dist .fuzz .hypothesis .benchmarks .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find drivers runtime sim_bridge tests -name __pycache__ -type d -exec rm -rf {} +
