# `make test` and `make demo` need Python 3.11 or newer, make and git; all else goes into .venv.
PYTHON ?= python3
BIN := .venv/bin
COMPILE := $(BIN)/uv pip compile --quiet --universal --generate-hashes --python-version 3.11 --no-header --no-annotate
COMPILED := setup.py build_backend/retrue_build.py $(wildcard src/retrue/kernels/*.py)

.PHONY: test demo docs examples browser format lock clean

test: .venv/dev.stamp .venv/run.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/pytest

demo: .venv/run.stamp
	$(BIN)/retrue demo --out demo-out

# The manual, into build/manual: readable from disk.
docs: .venv/dev.stamp .venv/run.stamp
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Writes what the manual's examples print and draw now; for after a change that alters it.
examples: .venv/dev.stamp .venv/run.stamp
	$(BIN)/python -m tests.docs

browser:  # for the tests of the HTML reports, on Debian; without it they are skipped
	apt-get install --yes chromium

format: .venv/dev.stamp
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock: .venv/dev.stamp
	$(COMPILE) pyproject.toml -o requirements.lock
	$(COMPILE) pyproject.toml --group dev -c requirements.lock -o requirements-dev.lock

clean:
	rm -rf .venv build demo-out src/retrue/kernels/*.so

.venv/run.stamp: .venv/locked.stamp pyproject.toml $(COMPILED)
	$(BIN)/python -m pip install --quiet --no-deps --editable .
	touch $@

.venv/dev.stamp: requirements-dev.lock .venv/locked.stamp
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements-dev.lock
	touch $@

.venv/locked.stamp: requirements.lock
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements.lock
	touch $@
