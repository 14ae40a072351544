# `make test` and `make demo` need Python 3.11 or newer, make and git; all else goes into .venv.
PYTHON ?= python3
BIN := .venv/bin
INSTALL := $(BIN)/python -m pip install --quiet --no-compile  # Python compiles what is imported, when it is
COMPILE := $(BIN)/uv pip compile --quiet --universal --generate-hashes --python-version 3.11 --no-header --no-annotate
COMPILED := setup.py build_backend/retrue_build.py $(wildcard src/retrue/kernels/*.py)

PYTEST ?=  # options of pytest

unexport PYTHONPATH  # what is installed is what is tried
unexport PYTHONDONTWRITEBYTECODE  # or each process compiles all that it imports, which takes as long again

.PHONY: test static dynamic demo studio docs examples browser display shells format lock wheels clean

# On two cores.
test: .venv/dev.stamp .venv/run.stamp
	$(MAKE) --no-print-directory --jobs=2 static dynamic

static: .venv/dev.stamp .venv/run.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/pyright --pythonpath $(BIN)/python

# Files go whole to one process, so that what a module's tests share is made once; linear algebra has one core each.
# In their own order, but the longest first (conftest.py): by number of tests, the few and long ones would come last.
dynamic: .venv/dev.stamp .venv/run.stamp
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest --numprocesses=2 --dist=loadfile --no-loadscope-reorder $(PYTEST)

demo: .venv/run.stamp
	$(BIN)/retrue demo --out demo-out

# A rig in the browser, simulated: no hardware is needed.
studio: .venv/studio.stamp
	$(BIN)/retrue studio --simulated

# The manual, into build/manual: readable from disk.
docs: .venv/dev.stamp .venv/run.stamp
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Writes what the manual's examples print and draw now; for after a change that alters it.
examples: .venv/dev.stamp .venv/run.stamp
	$(BIN)/python -m tests.docs

browser:  # for the tests of the HTML reports and the manual, on Debian; without it they are skipped
	command -v chromium || (apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends chromium)

display:  # a virtual screen for the tests of the projector's window, on Debian; without it they are skipped
	(command -v Xvfb && command -v weston) || (apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends xvfb weston libxrandr2 libgl1 libgl1-mesa-dri libegl1)

shells:  # for the tests of completion, on Debian; without them they are skipped
	command -v zsh || (apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends zsh)

format: .venv/dev.stamp
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock: .venv/dev.stamp
	$(COMPILE) pyproject.toml --extra plot -o requirements.lock
	$(COMPILE) pyproject.toml --group dev -c requirements.lock -o requirements-dev.lock
	$(COMPILE) pyproject.toml --extra studio -c requirements-dev.lock -o requirements-studio.lock

# Into dist: for Linux from glibc 2.17 on, by Zig; the one for this machine is tried in an environment of its own.
wheels:
	rm -rf dist build/wheels && $(PYTHON) -m venv build/wheels/tools
	build/wheels/tools/bin/python -m pip install --quiet "cython>=3.2,<4" "setuptools>=77" ziglang
	for arch in x86_64 aarch64; do \
		zig="build/wheels/tools/bin/python -m ziglang cc -target $$arch-linux-gnu.2.17"; \
		suffix=$$($(PYTHON) -c "import sys; print('.cpython-%d%d' % sys.version_info[:2])")-$$arch-linux-gnu.so; \
		CC="$$zig" LDSHARED="$$zig -shared" SETUPTOOLS_EXT_SUFFIX=$$suffix build/wheels/tools/bin/python -m pip wheel \
			--quiet --no-deps --no-build-isolation --wheel-dir dist \
			--config-settings=--build-option=--plat-name=manylinux_2_17_$$arch . || exit 1; \
	done
	$(PYTHON) -m venv build/wheels/fresh
	build/wheels/fresh/bin/python -m pip install --quiet --require-hashes -r requirements.lock
	build/wheels/fresh/bin/python -m pip install --quiet --no-deps dist/*_$$(uname -m).whl
	cd build/wheels && fresh/bin/retrue demo --out demo-out

clean:
	rm -rf .venv build demo-out src/retrue/kernels/*.so

.venv/run.stamp: .venv/locked.stamp pyproject.toml $(COMPILED)
	$(INSTALL) --no-deps --editable .
	touch $@

.venv/studio.stamp: requirements-studio.lock .venv/run.stamp
	$(INSTALL) --require-hashes -r requirements-studio.lock
	touch $@

.venv/dev.stamp: requirements-dev.lock .venv/locked.stamp
	$(INSTALL) --require-hashes -r requirements-dev.lock
	touch $@

.venv/locked.stamp: requirements.lock
	$(PYTHON) -m venv .venv
	$(INSTALL) --require-hashes -r requirements.lock
	touch $@
