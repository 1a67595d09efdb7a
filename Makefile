# make run | test | check | newest: each sets up .venv first if needed.

PYTHON ?= python3
PACKAGES := analytic models crosscheck reports
BIN := .venv/bin
STAMP := .venv/.setup-done
LINKS := build/typing/stewart_crosscheck
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-input

VERSION_OK := import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))
BUILD_REQUIRES := import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["build-system"]["requires"], sep="\n")

.PHONY: setup run test check newest lock clean typing

setup: $(STAMP) typing

# Written last, so an interrupted set-up leaves no stamp; without one .venv is made anew, whatever is there.
$(STAMP): pyproject.toml requirements.lock
	@if [ ! -e $@ ] || ! $(BIN)/python -c '$(VERSION_OK)' 2>/dev/null; then \
	  $(PYTHON) -c '$(VERSION_OK)' 2>/dev/null || { \
	    echo 'Python 3.11, 3.12 or 3.13 is needed and $(PYTHON) is not one: try make $(or $(MAKECMDGOALS),setup) PYTHON=python3.12' >&2; exit 1; }; \
	  echo 'Making .venv with $(PYTHON)'; \
	  $(PYTHON) -m venv --clear .venv || { rm -rf .venv; \
	    echo '$(PYTHON) can not make a virtual environment; on Debian and Ubuntu: apt install python3-venv' >&2; exit 1; }; \
	fi
	@rm -f $@
	@echo 'Installing requirements.lock'
	@$(PIP) --require-hashes --only-binary :all: --requirement requirements.lock
	@$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@

# What pyright reads (see pyproject.toml): links that give the folders their import names, and stubs for two
# packages that keep their names in compiled modules without type information.
typing:
	@mkdir -p $(LINKS)
	@for name in $(PACKAGES); do ln -sfn ../../../$$name $(LINKS)/$$name; done
	@for name in mujoco pinocchio; do \
	  printf 'from typing import Any\n\ndef __getattr__(name: str) -> Any: ...\n' > build/typing/$$name.pyi; done

run: setup
	$(BIN)/crosscheck run

test: setup
	$(BIN)/python -m pytest

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

# The newest engines that there are, also beyond the ranges in pyproject.toml: what will break, and when it did.
newest: setup
	$(PIP) --upgrade --only-binary :all: mujoco pin dartpy python-flint
	$(BIN)/crosscheck engines

# The newest versions that the ranges in pyproject.toml allow, for Python 3.11 and later.
lock:
	rm -rf build/lock && $(PYTHON) -m venv build/lock && build/lock/bin/python -m pip install --quiet uv
	build/lock/bin/python -c '$(BUILD_REQUIRES)' > build/lock/build.in
	build/lock/bin/uv pip compile --quiet --universal --python-version 3.11 --only-binary :all: --extra dev \
	  --generate-hashes --no-header --no-annotate --no-emit-index-url --no-emit-find-links \
	  pyproject.toml build/lock/build.in > build/lock/pins
	{ echo '# Run-time, development and build packages, exact. Written by "make lock"; see CONTRIBUTING.md.'; \
	  cat build/lock/pins; } > requirements.lock
	rm -rf build/lock

clean:
	rm -rf .venv build *.egg-info .pytest_cache .ruff_cache .hypothesis
