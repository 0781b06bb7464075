# Everything a contributor runs. `make` lists the targets.
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: help install test coverage check long results grand trust lint types bench docs demo ci
help:            ## list the targets
	@sed -n 's/^\([a-z]*\): *[^#]*## /\1	/p' $(MAKEFILE_LIST)

install: $(BIN)/trailmark  ## virtual environment with everything for development
$(BIN)/trailmark: pyproject.toml
	python3 -m venv $(VENV)
	$(BIN)/pip install -q -e '.[dev]'

test: install    ## all tests but the long ones
	$(BIN)/pytest -n 2

coverage: install ## the same with the lines that no test reaches; it takes half as long again
	$(BIN)/pytest -n 2 --cov --cov-report=term:skip-covered

check: install lint types  ## what a contributor waits for: lint, types, the tests that are not slow
	$(BIN)/pytest -n 2 --dist loadfile -m "not long and not slow"

long: install    ## the tests that take minutes
	$(BIN)/pytest -n 2 -m long

HOURS ?= 2
results: install ## the pages of results that are older than their code, the quickest first; it goes on any time
	$(BIN)/python benchmarks/results.py make --hours $(HOURS)

GRAND := docs/results/grand
grand: install   ## HOURS of the grand bench (recordings in TRAILMARK_DATA), its site and its page; it goes on any time, anywhere
	@test -d "$(TRAILMARK_DATA)" || { echo "set TRAILMARK_DATA: without recordings, results of their cells would be lost"; exit 1; }
	$(BIN)/pip install -q --no-compile ./examples/third_party_plugin
	$(BIN)/trailmark bench grand --only seed=0,1,2 --only place=first,second,third --jobs 2 --hours $(HOURS) \
	  --out runs/grand --results $(GRAND)/cells.json.xz --no-report
	$(BIN)/trailmark bench site runs/grand --to $(GRAND)/site
	$(BIN)/python benchmarks/results.py make grand

trust: install   ## hostile input by the thousand, kills, damage: all of it, and its two pages; goes on where it was
	$(BIN)/python benchmarks/results.py make hostile-input trust

lint: install    ## ruff: lint and format
	$(BIN)/ruff check . && $(BIN)/ruff format --check .

types: install   ## mypy --strict over core and all plugins
	$(BIN)/mypy

bench: install   ## the speed benchmarks, quick
	PYTHON=$(BIN)/python bash benchmarks/quick.sh

docs: install    ## the manual, into site/
	$(BIN)/pip install -q mkdocs-material 'mkdocstrings-python>=1.12' && $(BIN)/mkdocs build --strict

demo: install    ## the whole story in a minute
	$(BIN)/trailmark demo

ci:              ## what CI runs, in a fresh clone and a fresh virtual environment
	bash .ci/run
