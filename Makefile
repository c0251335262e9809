# Two commands do it all: `make run` and `make test`. Each first makes a virtual environment in .venv.
PYTHON ?= python3.11
VENV := .venv
SECONDS := 600
RUN := $(VENV)/bin/python

.PHONY: run app lint test soak chaos bench view docs pictures clean
.DEFAULT_GOAL := run

$(VENV)/ready: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip install --quiet --editable '.[app,secure,dev]'
	touch $@

run: $(VENV)/ready  ## the default orchard, from start to summary
	$(RUN) run.py

app: $(VENV)/ready  ## the page in the browser
	$(RUN) -m orchard.app

view: $(VENV)/ready  ## open the newest recording
	$(RUN) run.py view

lint: $(VENV)/ready  ## style, types, and the order of the packages
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check --quiet .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

test: $(VENV)/ready  ## all tests but the long matrix
	$(RUN) -m pytest --numprocesses 3 --dist loadfile

soak: $(VENV)/ready  ## the long matrix of equal hashes
	$(RUN) -m pytest -m soak

chaos: $(VENV)/ready  ## ten minutes of kills, freezes, cuts and nonsense, and 100,000 ticks: docs/chaos.md; SECONDS=120 is the short one
	$(RUN) -m chaos --seconds $(SECONDS)

bench: $(VENV)/ready  ## how fast it is, beside what else one could use: docs/benchmarks.md
	$(RUN) -m bench

docs: $(VENV)/ready  ## all generated files: keyspace.md, the schema, the drawings
	$(RUN) -m docs.generate

pictures: $(VENV)/ready  ## docs/orchard.png, by the viewer itself; needs .ci/apt-packages.txt
	$(RUN) docs/pictures.py

clean:
	rm -rf $(VENV) runs .pytest_cache .mypy_cache .hypothesis
