# davpc: `make help` lists what there is.
.DEFAULT_GOAL := help
.PHONY: help setup sim check test lint cover mutate prove campaign readme lock wheels clean

VENV := .venv
READY := $(VENV)/.ready
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
  $$p -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1 && echo $$p && break; done)
SIM_ARGS ?=
CAMPAIGN_ARGS ?=
MODULES ?=
BRIDGE_TESTS := tests/unit/follower/can_bridge
GATE_TESTS := $(addprefix $(BRIDGE_TESTS)/test_gate,.py _caps.py _wheels.py _window.py _encoders.py)
WATCH_TESTS := $(addprefix $(BRIDGE_TESTS)/test_,wheel_tracking.py angle_watch.py angle_watch_limits.py)

help: ## List the targets
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## (.*)/  make \1\t\2/' | expand -t 16

setup: $(READY) ## Make .venv from the lock file; leaves .venv/bin/davpc

$(READY): requirements.lock pyproject.toml
	@test -n "$(PYTHON)" || { echo "davpc needs Python >= 3.11 with the venv module (Debian: apt-get install python3-venv)"; exit 2; }
	@echo "[setup] making $(VENV) with $$($(PYTHON) --version)"
	@test -x $(VENV)/bin/pip || { rm -rf $(VENV); $(PYTHON) -m venv $(VENV); }
	@echo "[setup] installing the locked packages (about 350 MB, once)"
	@$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	@echo "[setup] installing davpc itself"
	@$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@
	@echo "[setup] done: try $(VENV)/bin/davpc --help"

sim: $(READY) ## One docking of both robots, simulated down to pixels and CAN frames
	@$(VENV)/bin/davpc sim $(SIM_ARGS)

check: $(READY) ## Before each commit: format, lint, types, import rules, unit and stepped tests
	@$(MAKE) --no-print-directory lint
	@echo "[check] unit and stepped tests"
	@$(VENV)/bin/python -m pytest -q -n auto --dist loadgroup -m "not alone"

test: check ## What CI runs: check, then the tests that start real-time processes, one at a time
	@echo "[test] process tests, one at a time"
	@$(VENV)/bin/python -m pytest -q -m alone

lint: $(READY) ## Format, lint, types, import rules
	@echo "[lint] format"; $(VENV)/bin/ruff format --check --quiet . || { echo "run: $(VENV)/bin/ruff format ."; exit 1; }
	@echo "[lint] ruff"; $(VENV)/bin/ruff check --quiet .
	@echo "[lint] types"; $(VENV)/bin/mypy --no-error-summary
	@echo "[lint] import rules"; $(VENV)/bin/lint-imports > .venv/lint-imports.log || { cat .venv/lint-imports.log; exit 1; }

cover: $(READY) ## Branch coverage of the gate by its own tests: anything below 100 % fails
	@$(VENV)/bin/python -m pytest -q --cov-branch --cov-fail-under=100 --cov-report=term-missing \
	  $(addprefix --cov=follower.can_bridge.,gate wheel_tracking angle_watch arm_gate) \
	  $(GATE_TESTS) $(WATCH_TESTS) $(BRIDGE_TESTS)/test_arm_gate.py

mutate: cover ## The same, then a mutation test of gate and supervisor: a survivor not listed fails (MODULES=… for a part)
	@OPENBLAS_NUM_THREADS=1 nice -n 10 $(VENV)/bin/python -m tests.mutation.mutate $(MODULES)

prove: $(READY) ## A million random steps of the gate, mutated CAN frames, events of both state machines
	@GATE_STEPS=1000000 FUZZ_FRAMES=1000000 MACHINE_EVENTS=1000000 $(VENV)/bin/python -m pytest -q --timeout 1200 \
	  $(BRIDGE_TESTS)/test_gate_properties.py $(BRIDGE_TESTS)/test_inbound_fuzz.py \
	  tests/unit/follower/supervisor/test_sequence_properties.py tests/unit/leader/test_lock_properties.py

LOCK = uv pip compile --universal --generate-hashes --no-header --no-annotate --no-strip-extras --python-version 3.11 --no-emit-package davpc

readme: $(READY) ## Every command of README.md in its smallest form, those that take minutes too
	@README_COMMANDS=all $(VENV)/bin/python -m pytest -q tests/system/test_readme_commands.py

campaign: $(READY) ## Every failure mode in 25 seeds, two at a time; interrupted, the same call goes on
	@$(VENV)/bin/davpc experiment campaign --seeds 25 --jobs 2 --out out/campaign $(CAMPAIGN_ARGS)

lock: ## Refresh requirements.lock and its part that a robot needs (needs uv)
	$(LOCK) --extra dev -o requirements.lock pyproject.toml
	$(LOCK) --extra build --extra record -c requirements.lock -o deploy/requirements.lock pyproject.toml

wheels: ## What a robot without a network is installed from: a folder of wheels for this machine's Python
	@deploy/install.sh wheels out/wheels

clean: ## Remove the environment and caches
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis
