# Two commands do it all: `make run` and `make test`. Each first makes a virtual environment in .venv, with what it needs.
PYTHON ?= python3
VENV := .venv
SECONDS := 600
COUNT := 1000
QUICK := tests/field tests/wire tests/plans/test_steps.py tests/net/test_lockstep.py tests/docs/test_package.py \
 $(patsubst %,tests/contract/test_%.py,read_only zones) \
 $(patsubst %,tests/sim/test_%.py,deeds invariants movement picking repeatable scan snapshot)
RUN := $(VENV)/bin/python
INSTALL := bash .ci/install $(VENV) --constraint constraints.txt --editable

unexport PYTHONDONTWRITEBYTECODE  # each of hundreds of processes would compile all its modules

.PHONY: run app study lint test quick ecosystem pythons package soak chaos schedules bench validate view docs site pictures clean
.DEFAULT_GOAL := run

$(VENV)/installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "$(PYTHON) is not Python 3.11 or newer, which the orchard\
	 needs: $$($(PYTHON) --version 2>&1). To name another: make $(MAKECMDGOALS) PYTHON=python3.11" >&2; exit 1; }
	@echo "installing into $(VENV), once: about 340 MB are loaded"
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) .
	touch $@

$(VENV)/installed-app: $(VENV)/installed
	$(INSTALL) '.[app,study,optimum]'
	touch $@

$(VENV)/installed-study: $(VENV)/installed
	$(INSTALL) '.[study,optimum]'
	touch $@

$(VENV)/installed-dev: $(VENV)/installed
	$(INSTALL) '.[app,secure,study,optimum,gym,survey,gis,tables,ros2-export,dev]' --editable bridges/ros2 --editable bridges/vda5050
	touch $@ $(VENV)/installed-app $(VENV)/installed-study

$(VENV)/installed-docs: $(VENV)/installed
	$(INSTALL) '.[docs,gym]'
	touch $@

$(VENV)/installed-release: $(VENV)/installed
	$(INSTALL) '.[release]'
	touch $@

run: $(VENV)/installed  ## the default orchard, from start to summary
	$(RUN) run.py

app: $(VENV)/installed-app  ## the page in the browser
	$(VENV)/bin/orchard app

study: $(VENV)/installed-study  ## how many carriers for people who pick a hectare? docs/study.md
	$(VENV)/bin/orchard study hand_picking

view: $(VENV)/installed  ## open the newest recording
	$(VENV)/bin/orchard view

lint: $(VENV)/installed-dev  ## style, types, the order of the packages, and how the code reads
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check --quiet .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports
	$(RUN) .ci/readability.py
	$(VENV)/bin/codespell

test: $(VENV)/installed-dev  ## all tests but the long matrix
	$(RUN) -m pytest --numprocesses 3 --dist worksteal

quick: $(VENV)/installed-dev  ## the tests that tell most, in at most 90 s
	$(RUN) -m pytest --numprocesses 2 --dist loadfile $(QUICK)

ecosystem: $(VENV)/installed-dev  ## the tests against ROS 2 and other software, each in an environment of its own
	bash .ci/ecosystem

pythons: $(VENV)/installed-dev  ## the core of the tests on every other Python from 3.11 on that is here
	bash .ci/pythons

package: $(VENV)/installed-dev $(VENV)/installed-release  ## wheel and source archive: built, checked, installed and run outside the tree; its SBOM and licences, in dist/
	bash .ci/package

soak: $(VENV)/installed-dev  ## the long matrix of equal hashes, then all tests with newly drawn examples
	$(RUN) -m pytest -m soak --hypothesis-profile search
	$(RUN) -m pytest --hypothesis-profile search --numprocesses 3 --dist worksteal

chaos: $(VENV)/installed-dev  ## ten minutes of kills, freezes, cuts and nonsense, and 100,000 ticks: chaos/results.md; SECONDS=120 is the short one
	$(RUN) -m chaos --seconds $(SECONDS)

schedules: $(VENV)/installed-dev  ## runs on a simulated network, with faults, one for each seed; COUNT=1000; WITHIN=180: as many of them as fit into 180 s
	$(RUN) -m chaos.simulated --count $(COUNT) $(if $(WITHIN),--seconds $(WITHIN))

bench: $(VENV)/installed-dev  ## how fast it is, beside what else one could use: bench/results.md
	$(RUN) -m bench

validate: $(VENV)/installed-dev  ## what published curves say, measured again, and docs/validation.md
	$(RUN) -m docs.validation
	$(RUN) -m docs.generate

docs: $(VENV)/installed-dev  ## all generated files, from the code and from what was measured
	$(RUN) -m docs.generate

site: $(VENV)/installed-docs  ## the documents as a site, in .site/html; it runs the notebook
	$(VENV)/bin/sphinx-build --quiet --fail-on-warning --keep-going --conf-dir docs . .site/html

pictures: $(VENV)/installed-dev  ## docs/orchard.png and docs/exchange.webp, by the viewer itself; needs .ci/apt-packages.txt
	$(RUN) docs/pictures.py

clean:  ## what make has made here; recordings and snapshots in runs/ stay
	rm -rf $(VENV) .site .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis build dist *.egg-info
