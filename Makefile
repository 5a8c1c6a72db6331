# Two commands for a first look; both make .venv on a fresh machine.
PYTHON ?= python3
VENV := .venv
STAMP := $(VENV)/.installed
TEST_STAMP := $(VENV)/.installed-test
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check

# Commands would compile all modules again at each start where this is set, as in many containers.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test fuzz check docs-pictures docs-tutorial docs-site clean

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

# What a run imports it compiles when it first does; to compile all that is installed takes as long as installing.
$(STAMP): $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) install --quiet --no-compile --constraint constraints.txt --editable .
	touch $@

$(TEST_STAMP): $(STAMP)
	$(PIP) install --quiet --no-compile --constraint constraints.txt torch
	$(PIP) install --quiet --no-compile --constraint constraints.txt --editable '.[all,dev]'
	touch $@

demo: $(STAMP)
	$(VENV)/bin/scex-sumo run scex_sumo/scenarios/data/roundabout.osm -o out/demo --overwrite

# The processes are the parallelism: threads of each for small matrices would only wait for each other.
test: $(TEST_STAMP)
	OMP_NUM_THREADS=1 $(VENV)/bin/python -m pytest --numprocesses auto --dist worksteal

fuzz: $(TEST_STAMP)
	$(VENV)/bin/python -m tests.fuzz --cases 10000

check: $(TEST_STAMP)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports --no-logo

docs-pictures: $(TEST_STAMP)
	$(VENV)/bin/python docs/make_pictures.py

docs-tutorial: $(TEST_STAMP)
	$(VENV)/bin/python docs/run_tutorial.py

docs-site: $(TEST_STAMP)
	$(VENV)/bin/python docs/make_site.py

clean:
	rm -rf $(VENV) out build dist
