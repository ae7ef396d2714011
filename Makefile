# SPDX-License-Identifier: Apache-2.0
# Everything runs in a virtual environment of the project's own, .venv, made on first use and
# brought up to date when setup.py changes. An activated environment is neither used nor touched.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PYTEST_ARGS ?=
BENCH_ARGS ?=
DASHBOARD_ARGS ?=
FUZZ_ARGS ?=
SIMULATE_ARGS ?=

# .venv has its own ROS 2; what another one (a sourced setup.bash, say) left here would mix in.
unexport AMENT_PREFIX_PATH LD_LIBRARY_PATH PYTHONHOME PYTHONPATH RMW_IMPLEMENTATION
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE

.DEFAULT_GOAL := help
# Two installations into one environment must not run at once.
.NOTPARALLEL:
SIGNALK := test/monitor/links/signalk_server
.PHONY: help setup demo demo-ship dashboard signalk-server test test-all test-alone lint format docs bags
.PHONY: bench bench-soak calibration-study fuzz simulate warning-quality colcon-test clean

help:  ## Show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-15s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: $(VENV)/.run  ## Make .venv with ROS 2 and the commands: `source .venv/bin/activate`

demo: $(VENV)/.run  ## Watch the node warn while a recorded coast-down is played to it
	@$(BIN)/python scripts/demo.py

demo-ship: $(VENV)/.ship  ## Watch a ship without ROS: speed from Signal K, the alarm on a display
	@! command -v npm >/dev/null || $(MAKE) --no-print-directory signalk-server
	@$(BIN)/python -m scripts.demo_ship

signalk-server: $(SIGNALK)/node_modules  ## Install the locked signalk-server for tests and demo-ship (npm)
$(SIGNALK)/node_modules: $(SIGNALK)/package-lock.json
	cd $(SIGNALK) && npm ci --omit=optional --ignore-scripts --no-audit --no-fund
	@touch $@

dashboard: $(VENV)/.run  ## Show the recorded coast-down on the dashboard, in a browser
	@echo 'Ctrl-C ends it. The coast-down lasts 28 seconds; the page then stays as it ended.'
	@$(BIN)/stickslip dashboard --config launch_configs/reference_bearing.yaml \
	    --bag bags/coast_down --rate 10 $(DASHBOARD_ARGS)

test: $(VENV)/.test  ## Run the everyday tests (PYTEST_ARGS='-k friction' for some of them)
	$(BIN)/python -m pytest -n 2 --dist loadfile -m 'not slow' $(PYTEST_ARGS)

test-all: $(VENV)/.test  ## Run all tests, those marked slow too
	$(BIN)/python -m pytest -n 2 --dist loadfile $(PYTEST_ARGS)

test-alone: $(VENV)/.test  ## Run the everyday tests of the packages without those above them
	$(BIN)/python scripts/try_alone.py -- -n 2 --dist loadfile $(PYTEST_ARGS)

lint: $(VENV)/.lint  ## Check style, format, types and who imports whom
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

format: $(VENV)/.lint  ## Mend what the linter and the formatter can mend
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(VENV)/.docs  ## Write what docs/ has from the program, build the site in build/site; a warning is an error
	$(BIN)/python scripts/make_docs.py
	$(BIN)/mkdocs build --quiet

bags: $(VENV)/.run  ## Make the recordings of bags/ again from their scenes
	$(BIN)/python scripts/make_bags.py

bench: $(VENV)/.bench  ## Compare with what others use, some minutes; writes benchmarks/results.md
	$(BIN)/python -m benchmarks $(BENCH_ARGS)

warning-quality: $(VENV)/.bench  ## Judge the warnings over 140 voyages and 80 manoeuvres, five minutes on two cores; writes docs/warning_quality.md
	PYTHONPATH=. $(BIN)/python scripts/warning_quality.py

calibration-study: $(VENV)/.bench  ## What calibration reaches, five minutes on two cores; writes docs/calibration.md
	$(BIN)/python -m benchmarks.calibration_study

bench-soak: $(VENV)/.bench  ## Add ten minutes of telemetry at 1 kHz to benchmarks/results.md
	$(BIN)/python -m benchmarks --soak

simulate: $(VENV)/.test  ## Sail a million seconds under faults and manoeuvres, a quarter of an hour; SIMULATE_ARGS='--seed 17' repeats one
	$(BIN)/python scripts/simulate.py $(SIMULATE_ARGS)

fuzz: $(VENV)/.test  ## Read thousands of damaged recordings beside MCAP's own reader
	$(BIN)/python -m fuzz $(FUZZ_ARGS)

colcon-test: $(VENV)/.test  ## Build and test as in a ROS 2 workspace, under build/colcon
	$(BIN)/colcon --log-base build/colcon/log build \
	    --base-paths . --build-base build/colcon/build --install-base build/colcon/install
	$(BIN)/colcon --log-base build/colcon/log test --event-handlers console_direct+ \
	    --base-paths . --build-base build/colcon/build --install-base build/colcon/install
	$(BIN)/colcon --log-base build/colcon/log test-result --test-result-base build/colcon/build --verbose

clean:  ## Remove all that the targets above made
	rm -rf $(VENV) build install log dist .mypy_cache .pytest_cache .ruff_cache .hypothesis
	rm -rf *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The environment and one stamp for each set of extras; a stamp newer than setup.py installs nothing.
$(BIN)/python:
	@echo 'Making a virtual environment in $(VENV) ...'
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10) and "Python 3.10 or later is needed")'
	@$(PYTHON) -m venv $(VENV)

$(VENV)/.run: EXTRAS = dashboard,ros,report
$(VENV)/.ship: EXTRAS = dashboard,links
$(VENV)/.test: EXTRAS = dashboard,links,ros,report,test
$(VENV)/.lint: EXTRAS = dashboard,links,ros,report,lint
$(VENV)/.bench: EXTRAS = links,ros,report,bench
$(VENV)/.docs: EXTRAS = docs,report
$(VENV)/.run $(VENV)/.ship $(VENV)/.test $(VENV)/.bench $(VENV)/.lint $(VENV)/.docs: setup.py pyproject.toml | $(BIN)/python
	@echo 'Installing stickslip_monitor[$(EXTRAS)] into $(VENV), once (a minute or two) ...'
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --editable '.[$(EXTRAS)]'
	@touch $@
