# Two commands do everything: `make demo` and `make test`. They need Python 3.10+ and a package registry.

PYTHON ?= python3
# tests of one file stay together: several of them start processes. As they stand, the longest are in the middle, and
# all workers end at one time; in the order of xdist, by the number of tests, the flights are the last. Three workers on
# two cores: a third of the time of the tests is waiting for processes
PYTEST_ARGS ?= -n 4 --dist loadfile --no-loadscope-reorder
VENV := .venv
BIN := $(VENV)/bin
# pytest and every program that a test starts keep what they have compiled: without it each worker rewrites the asserts
# of all tests again, half a minute
unexport PYTHONDONTWRITEBYTECODE
# what building leaves behind
BUILT := build *.egg-info sitl/build sitl/*.egg-info
SOURCES := $(shell find mavproxy_handover gcs_module sitl missions ardupilot_lua reference -type f \
             -not -path '*/__pycache__/*' -not -path 'sitl/build/*' -not -path '*.egg-info/*') \
           pyproject.toml setup.py constraints.txt

.DEFAULT_GOAL := help
.PHONY: help demo quick test run-tests check lint types language lint-lua format clean bench fuzz explore mutants scenarios soak flights hosts picture clients docs reference

help:
	@echo "make demo    set up, fly the delivery mission in simulation, write a report"
	@echo "make quick   set up, run the tests that find most faults, in a minute: rules, gate, wire, configuration, stations"
	@echo "make test    set up, check formatting, lint and types, run the tests"
	@echo "make check   the same, and Lua lint where luacheck is installed"
	@echo "make lint    set up, check formatting and lint"
	@echo "make types   set up, check types"
	@echo "make language  plain English in docstrings, comments, messages, documents (ARGS='--count', files or folders)"
	@echo "make bench   speed against stock MAVProxy, transfer durations under loss and delay"
	@echo "make explore the reachable states of the real core, deep, 40 minutes; ARGS='--states 0 NAME': a setting to its end"
	@echo "make fuzz    coverage-guided fuzzing of gate, feeds, onboard programs, packages, ground link, streams, files"
	@echo "make mutants plant faults in gate, core and guard, see the tests find them"
	@echo "make scenarios  fly every scenario on every vehicle there is"
	@echo "make soak    an hour of cut leases on ArduCopter, at speed-up; ARGS='--arducopter PATH ...': on each of these"
	@echo "make flights fly guard and energy in every situation on ArduPilot (ARGS as above), write the guard's table"
	@echo "make hosts   fly with each program on a host of its own (network namespaces, WireGuard): needs root"
	@echo "make clients fly with other ground station programs (MAVProxy, DroneKit, MAVSDK, pymavlink), print their times;"
	@echo "             installs each apart; ARGS='--arducopter PATH': with ArduCopter too"
	@echo "make docs    the documentation as a site, in site/"
	@echo "make picture draw docs/architecture.svg from the imports"
	@echo "make reference  write docs/reference from the code"
	@echo "make format  format the Python files"
	@echo "make clean   remove everything that make made"

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
	  { echo "Python 3.10 or newer is needed; choose one with: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/dependencies: $(BIN)/python pyproject.toml constraints.txt setup.py sitl/pyproject.toml sitl/setup.py
	@echo "Installing what the project needs (a few minutes the first time) ..."
	$(BIN)/python -m pip install --quiet --upgrade pip setuptools wheel
	@rm -rf $(BUILT)
	$(BIN)/python -m pip install --quiet -c constraints.txt '.[dev]' ./sitl
	@rm -rf $(BUILT)
	@touch $@

# What runs is what a user gets: the installed package, made anew whenever a source changes.
$(VENV)/installed: $(VENV)/dependencies $(SOURCES)
	@rm -rf $(BUILT)
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --force-reinstall . ./sitl
	@rm -rf $(BUILT)
	@touch $@

demo: $(VENV)/installed
	$(BIN)/handover sim --scenario nominal

QUICK := $(addprefix tests/,core gate wire config operator companion link vehicle monitors)
quick: $(VENV)/installed
	$(BIN)/pytest -n 2 -m 'not slow and not process' $(QUICK)

# the type checker keeps one core busy: the tests do not wait for it
test: lint
	@$(MAKE) --no-print-directory -j 2 types run-tests

run-tests: $(VENV)/installed
	$(BIN)/pytest $(PYTEST_ARGS)

check: lint-lua test

lint: $(VENV)/installed
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(VENV)/installed
	$(BIN)/mypy mavproxy_handover gcs_module sitl

language: $(VENV)/installed
	$(BIN)/python -m tests.structure.language $(ARGS)

lint-lua:
	@if command -v luacheck > /dev/null; then luacheck --config ardupilot_lua/.luacheckrc ardupilot_lua; \
	  else echo "luacheck is not installed (Debian: lua-check): the Lua lint was SKIPPED"; fi

bench: $(VENV)/installed
	$(BIN)/python -m sitl.bench $(ARGS)

fuzz: $(VENV)/installed
	$(BIN)/python -m pip install --quiet atheris
	$(BIN)/python tests/fuzz/fuzz.py --seconds $(or $(FUZZ_SECONDS),60) $(ARGS)

explore: $(VENV)/installed
	$(BIN)/python tests/model/explore.py --quick
	$(BIN)/python tests/model/explore.py $(ARGS)

mutants: $(VENV)/installed
	$(BIN)/python tests/mutation/run.py --lines $(VENV)/mutants-gate.lines
	$(BIN)/python tests/mutation/core.py --record $(VENV)/mutants.json $(ARGS)
	$(BIN)/python -m tests.lua.plant_faults --record $(VENV)/guard-mutants.json

scenarios: $(VENV)/installed
	$(BIN)/python -m sitl.fly_all $(ARGS)

soak: $(VENV)/installed
	$(BIN)/python -m tests.sitl.soak_guard $(ARGS)

flights: $(VENV)/installed
	$(BIN)/pytest -n 2 -m sitl --long $(sort $(wildcard tests/sitl/test_guard_*.py)) tests/sitl/test_starts_of_the_guard.py tests/sitl/test_energy_arducopter.py \
	  --flown ardupilot_lua/handover_guard.md $(ARGS)

hosts: $(VENV)/installed
	$(BIN)/pytest --long tests/sitl/test_hosts.py $(ARGS)

# the programs of others, each in an environment of its own
clients: $(VENV)/installed
	$(BIN)/python -m tests.clients.install $(VENV)/clients
	$(BIN)/pytest tests/clients --clients $(VENV)/clients $(ARGS)

reference: $(VENV)/installed
	$(BIN)/python -m reference

picture: $(VENV)/installed
	$(BIN)/python -m tests.structure.picture

docs: $(VENV)/installed
	$(BIN)/python docs/site/stage.py build/pages
	cd build/pages && $(CURDIR)/$(BIN)/zensical build --strict
	rm -rf site && mv build/pages/site site

format: $(VENV)/installed
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) $(BUILT) dist site runs .pytest_cache .mypy_cache .ruff_cache .hypothesis
