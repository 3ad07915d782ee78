# Two commands do all set-up: `make run` and `make test`. They need Python >= 3.11, make, and a
# network for the first installation into .venv, which is repeated only when pyproject.toml changed.

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help run run-all test check bench verify fuzz mutants lock docs clean

# another Python: make PYTHON=/path/to/python3.12 run
PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	if $$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then echo $$p; break; fi; \
	done)
# further arguments: make run ARGS=--force, make test ARGS="-k capstan"
ARGS ?=
# and those of pip
PIP_FLAGS ?=

VENV := .venv
BIN := $(VENV)/bin
RUNTIME := $(VENV)/.installed-runtime
DEVELOPMENT := $(VENV)/.installed-development
BENCHMARK := $(VENV)/.installed-benchmark
PIP_INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS)

help:  ## show this help
	@echo "beltid: contact parameters between a V-ribbed belt and a pulley"
	@echo
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)
	@echo
	@echo "  ARGS=... adds arguments (make run ARGS=--force), PYTHON=... names another Python."

run: $(RUNTIME)  ## the whole chain for the 5PK belt, results in runs/5pk
	@echo "The recordings in rigdata/ are synthetic (rigdata/README.md)." >&2
	$(BIN)/beltid run configs/5pk.yaml $(ARGS)

run-all: $(RUNTIME)  ## the same for the belts 4PK, 5PK and 6PK
	@echo "The recordings in rigdata/ are synthetic (rigdata/README.md)." >&2
	$(BIN)/beltid run configs/4pk.yaml configs/5pk.yaml configs/6pk.yaml $(ARGS)

# the tests start dozens of processes: bytecode is kept for them, whatever the environment says
test: $(DEVELOPMENT)  ## the tests, in two processes (one: make test ARGS="-n 0")
	@# a compiled kernel does not see an edit of another that it calls: what is older goes
	@newest=$$(ls -t beltid/rig/*.py beltid/laws/*.py beltid/drive/*.py | head -n 1); \
		find beltid -name '*.nb[ic]' ! -newer "$$newest" -delete
	PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder $(ARGS)

check: $(DEVELOPMENT)  ## formatting, lint, types, import contracts, size of the house
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m benchmarks.house

bench: $(BENCHMARK)  ## the benchmark beside its peer; writes benchmarks/RESULTS.md
	$(BIN)/python -m benchmarks.bench $(ARGS)

verify: $(DEVELOPMENT)  ## long proofs that the tests cannot wait for; each writes its table
	$(BIN)/python -m pytest -m long
	$(BIN)/python -m benchmarks.verify
	$(BIN)/python -m benchmarks.coverage
	$(BIN)/python -m benchmarks.faults

fuzz: $(DEVELOPMENT)  ## properties against new examples, every reader against 150,000 changed files
	$(BIN)/python -m pytest -m hypothesis --hypothesis-profile search
	$(PIP_INSTALL) --editable ".[fuzz]" && $(BIN)/python -m benchmarks.fuzz $(ARGS)

mutants: $(DEVELOPMENT)  ## small faults in the science, which its tests must see
	$(PIP_INSTALL) --editable ".[care]" && $(BIN)/python -m benchmarks.mutants $(ARGS)

lock: $(DEVELOPMENT)  ## the newest dependencies, with their hashes, to requirements*.lock
	$(PIP_INSTALL) --editable ".[care]" && for s in ":" "-dev:--extra dev"; do $(BIN)/uv pip compile pyproject.toml $${s#*:} --python-version 3.11 --universal --generate-hashes --no-header -q --upgrade -o requirements$${s%%:*}.lock; done

docs: $(DEVELOPMENT)  ## the pages of docs/ as HTML in docs/_build/html
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs docs/_build/html

clean:  ## remove .venv, caches and the results of run and run-all
	rm -rf $(VENV) runs/4pk runs/5pk runs/6pk dist build docs/_build
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache .benchmarks
	find beltid tests -type d -name __pycache__ -prune -exec rm -rf {} +

$(RUNTIME): pyproject.toml | $(BIN)/python
	@echo "installing beltid into $(VENV) ..." >&2
	$(PIP_INSTALL) --editable .
	@touch $@

# holds the runtime as well
$(DEVELOPMENT): pyproject.toml | $(BIN)/python
	@echo "installing beltid and its development tools into $(VENV) ..." >&2
	$(PIP_INSTALL) --editable ".[dev]"
	@touch $(RUNTIME) $@

$(BENCHMARK): pyproject.toml | $(BIN)/python
	@echo "installing beltid and the benchmark's peer into $(VENV) ..." >&2
	$(PIP_INSTALL) --editable ".[bench]"
	@touch $(RUNTIME) $@

$(BIN)/python:
	@if [ -z "$(PYTHON)" ]; then \
		echo "Python >= 3.11 is needed, none was found; name one: make PYTHON=/path/to/python" >&2; \
		exit 1; \
	fi
	@$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else \
		"Python >= 3.11 is needed, $(PYTHON) is %d.%d; name another: make PYTHON=/path/to/python" \
		% sys.version_info[:2])'
	@# a virtual environment without pip is half a one (Debian: apt install python3-venv)
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); exit 1; }
