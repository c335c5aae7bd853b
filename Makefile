# Everything is done in .venv, which the first target makes. Needs Python 3.11 or later, with venv, and make.

PYTHON ?= $(shell for p in python3 python3.11 python3.12 python3.13 python3.14; do \
	$$p -c 'import sys, venv; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check install --quiet
WORKERS ?= $(shell getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2)
ARGS ?=

.PHONY: help install install-dev install-formats install-plant install-fleet demo serve test test-slow test-all chaos bench peers figures evaluate evaluate-wide check format site lint-docker sbom audit lock clean

help:
	@echo 'make demo         service, replay of the bundled campaign, summary, page (ARGS=--exit: end after it)'
	@echo 'make install      the gear-twin command, in .venv/bin'
	@echo 'make serve        the service alone'
	@echo 'make install-formats   readers of TDMS, MDF4, HDF5, MAT 7.3 and Parquet files for gear-twin import'
	@echo 'make install-plant     PostgreSQL, MQTT, OPC UA and OpenTelemetry for the service'
	@echo 'make install-fleet     Ray, PostgreSQL and object stores for gear-twin fleet'
	@echo 'make test         the tests of under a second or so; test-slow: the longer proofs; test-all: both'
	@echo 'make chaos        faults and attacks drawn from seeds (ARGS="--count N --seed S": how many, which)'
	@echo 'make bench        all benchmarks, with their aims'
	@echo 'make peers        gear-twin and its peers (exudyn, ROSS, ProgPy, scipy, mcap) on the same problems'
	@echo 'make evaluate     campaigns with undeclared effects: named, and errors before and after (ARGS=--help: options)'
	@echo 'make evaluate-wide  the same on three machines, with unknown effects, growth, false alarms and bands (ARGS=--draw 2)'
	@echo 'make figures      writes the tables of figures in README and docs anew (ARGS=PART: one of them)'
	@echo 'make check        ruff and mypy; format: put the code in form; lint-docker: the Dockerfile'
	@echo 'make site         the documentation as a site, in build/site, with warnings as errors'
	@echo 'make sbom         bill of materials and licences, in build/sbom; audit: known weaknesses of the packages'
	@echo 'make lock         resolve the locked packages again (needs uv)'
	@echo 'make clean        remove .venv and all that was made'

install: $(VENV)/.installed
install-dev: $(VENV)/.installed-dev
install-formats: $(VENV)/.installed-formats
install-plant: $(VENV)/.installed-plant
install-fleet: $(VENV)/.installed-fleet

$(VENV)/.python:
	@test -n "$(PYTHON)" || { echo 'no Python 3.11 or later with venv found: install one, or name it: make PYTHON=...' >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

KERNELS := setup.py $(wildcard twin/compiled/source/*)

$(VENV)/.installed: requirements.lock pyproject.toml $(KERNELS) | $(VENV)/.python
	@echo 'installing what the program needs: about a minute'
	@$(PIP) --require-hashes -r requirements.lock
	@$(PIP) --no-deps --editable .
	@touch $@

$(VENV)/.installed-formats: requirements-formats.lock | $(VENV)/.installed
	@echo 'installing the readers of other file formats'
	@$(PIP) --require-hashes -r requirements-formats.lock
	@touch $@

$(VENV)/.installed-plant: requirements-plant.lock | $(VENV)/.installed
	@echo 'installing what connects the service to a plant'
	@$(PIP) --require-hashes -r requirements-plant.lock
	@touch $@

$(VENV)/.installed-fleet: requirements-fleet.lock | $(VENV)/.installed
	@echo 'installing what a fleet needs: Ray, PostgreSQL and object stores'
	@$(PIP) --require-hashes -r requirements-fleet.lock
	@touch $@

$(VENV)/.installed-dev: requirements-dev.lock | $(VENV)/.installed
	@echo 'installing what its development needs: one to two minutes'
	@$(PIP) --require-hashes -r requirements-dev.lock
	@touch $@

demo: install
	$(BIN)/gear-twin demo $(ARGS)

serve: install
	$(BIN)/gear-twin serve $(ARGS)

test: install-dev
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal $(ARGS)

test-slow: install-dev
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -m slow $(ARGS)

test-all: install-dev
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -m 'slow or not slow' $(ARGS)

chaos: install-dev
	$(BIN)/python -m tests.chaos frames $(ARGS)
	$(BIN)/python -m tests.chaos recordings --processes $(WORKERS) $(ARGS)
	$(BIN)/python -m tests.chaos rigs --processes $(WORKERS) $(ARGS)
	$(BIN)/python -m tests.chaos measurements --processes $(WORKERS) $(ARGS)
	$(BIN)/python -m tests.chaos http $(ARGS)
	$(BIN)/python -m tests.chaos guided $(ARGS)
	$(BIN)/python -m tests.chaos kills $(ARGS)
	$(BIN)/python -m tests.chaos kills --postgresql $(ARGS)
	$(BIN)/python -m tests.chaos schedules --processes $(WORKERS) $(ARGS)
	$(BIN)/python -m tests.chaos fleet $(ARGS)

bench: install-dev
	$(BIN)/python -m benchmarks $(ARGS)

peers: install-dev
	$(BIN)/python -m benchmarks.peers $(ARGS)

figures: install-dev
	$(BIN)/python -m benchmarks.figures $(ARGS)

evaluate: install-dev
	$(BIN)/python -m benchmarks.evaluate --processes $(WORKERS) $(ARGS)
	@echo 'the same with twice the spreads of structure and instruments'
	$(BIN)/python -m benchmarks.evaluate --processes $(WORKERS) --set judge --spreads 2 $(ARGS)

evaluate-wide: install-dev
	$(BIN)/python -m benchmarks.evaluate --processes $(WORKERS) --set wide clean $(ARGS)

check: install-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy gear_twin twin service studies recordings benchmarks

format: install-dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

site: install-dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict $(ARGS)

lint-docker: install-dev
	$(BIN)/hadolint docker/Dockerfile

sbom: install-dev
	$(BIN)/python -m benchmarks.packages sbom

audit: install-dev
	$(BIN)/python -m benchmarks.packages audit

lock:
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-emit-index-url \
		--extra analysis pyproject.toml -o requirements.lock
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-emit-index-url \
		--extra analysis --extra dev --extra formats --extra docs --extra plant --extra fleet -c requirements.lock pyproject.toml -o requirements-dev.lock
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-emit-index-url \
		--extra analysis --extra formats -c requirements-dev.lock pyproject.toml -o requirements-formats.lock
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-emit-index-url \
		--extra plant -c requirements-dev.lock pyproject.toml -o requirements-plant.lock
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --no-emit-index-url \
		--extra fleet -c requirements-dev.lock pyproject.toml -o requirements-fleet.lock

clean:
	rm -rf $(VENV) twin/compiled/*.so build dist *.egg-info .gear-twin .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
