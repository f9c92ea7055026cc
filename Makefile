# The project's commands. Each sets up a virtual environment by itself the first time, and again when
# pyproject.toml or the pinned versions change; otherwise it starts at once. Needs git, make and Python 3.11 or 3.12.

SUPPORTED := 3.11 3.12
SAY_VERSION := -c 'import sys; print("%d.%d" % sys.version_info[:2])'

# A command counts only if it runs: pyenv leaves shims that exist and do nothing.
version = $(shell $(1) $(SAY_VERSION) 2>/dev/null)
first_supported = $(firstword $(foreach python,$(1),$(if $(filter $(SUPPORTED),$(call version,$(python))),$(python))))
DEFAULT := $(or $(call first_supported,python3.11),$(call first_supported,python3 python3.12),python3)

PYTHON ?= $(DEFAULT)
VERSION := $(call version,$(PYTHON))

# The default Python's environment is .venv, where the README looks for it; another Python given by hand
# (PYTHON=python3.12 make test) gets its own beside it, so that changing to and fro installs nothing anew.
VENV := .venv$(if $(filter-out $(call version,$(DEFAULT)),$(VERSION)),-$(VERSION))
BIN := $(VENV)/bin
CONSTRAINTS := constraints/py$(subst .,,$(VERSION)).txt
STAMP := $(VENV)/.installed-$(VERSION)

# One thread a process: the tests run side by side. Offline: no test may depend on a server.
test test-slow check: export OMP_NUM_THREADS := 1
test test-slow check: export HF_HUB_OFFLINE := 1

.PHONY: help test test-slow check docs demo setup clean
help:
	@echo "make demo       everything once, small: records, pairs, learns, trains policies, writes a page"
	@echo "make test       ruff, mypy and the tests"
	@echo "make test-slow  the tests that are marked slow"
	@echo "make check      ruff and mypy only"
	@echo "make docs       the documentation as a site, in site/"
	@echo "make setup      only set up $(VENV)"
	@echo "make clean      remove the environments and caches"

demo: $(STAMP)
	@$(BIN)/nas demo

test: check
	@$(BIN)/python -m pytest -n 2 --dist worksteal

test-slow: $(STAMP)
	@$(BIN)/python -m pytest -m slow

check: $(STAMP)
	@$(BIN)/ruff check --quiet
	@$(BIN)/ruff format --check --quiet
	@$(BIN)/mypy

docs: $(STAMP)
	@$(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check -c $(CONSTRAINTS) -e '.[docs]'
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet
	@echo "open site/index.html"

setup: $(STAMP)

# The wildcard stands for the constraints where VERSION is none that we support: the recipe then says so.
$(STAMP): pyproject.toml $(wildcard $(CONSTRAINTS))
	@case " $(SUPPORTED) " in *" $(VERSION) "*) ;; *) \
	  echo "nas_data needs Python $(subst $() $(), or ,$(SUPPORTED)), but '$(PYTHON)' is" \
	    "$(or $(VERSION),no Python that runs); install one and name it: PYTHON=python3.11 make test" >&2; exit 2;; esac
	@echo "setting up $(VENV) with Python $(VERSION) (some minutes, once) …" >&2
	@test "$$($(BIN)/python $(SAY_VERSION) 2>/dev/null)" = $(VERSION) && $(BIN)/python -m pip --version >/dev/null 2>&1 \
	  || $(PYTHON) -m venv --clear $(VENV)
	@$(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check -c $(CONSTRAINTS) -e '.[dev]'
	@touch $@
	@echo "$(VENV) is ready" >&2

clean:
	rm -rf .venv .venv-* .mypy_cache .pytest_cache .ruff_cache .hypothesis
