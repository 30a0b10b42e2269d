# Every target creates the environment it needs, once: a virtual environment with the versions pinned in
# requirements/. The demo installs what users need; all other targets add the developer tools to the same environment.
# Choose the interpreter with PYTHON, such as: make test PYTHON=python3.12

PYTHON ?= python3
BIN := .venv/bin
READY := .venv/.ready
USER_READY := .venv/.ready-user
BIN4 := .venv-opencv4/bin
READY4 := .venv-opencv4/.ready
BINS := .venv-sbom/bin

.PHONY: demo test lint format docs test-opencv4 sbom clean

demo: $(USER_READY)
	$(BIN)/ospc demo --out demo

# Each worker begins with half of the tests in their order, so that fixtures of modules are hardly ever made twice.
# Compiled tests and modules are kept even where the environment says otherwise: every process would compile them again.
test: $(READY)
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n 2 --dist worksteal

# The documentation is checked by building it without writing pages: links, references, docstrings.
lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m sphinx -q -W --keep-going -b dummy docs docs/_build/checked

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

docs: $(READY)
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs docs/_build/html
	@echo docs/_build/html/index.html

# The oldest supported OpenCV, with the NumPy of its time (Python 3.11 or 3.12). Whole commands are left out: they take
# most of the time, and the other tests cover what they use.
test-opencv4: $(READY4)
	$(BIN4)/python -m pytest -n 2 --dist worksteal --ignore tests/cli

# The software bill of materials: what a user gets, with versions and licences, as CycloneDX.
sbom: $(BINS)/cyclonedx-py
	$(BINS)/cyclonedx-py environment --output-reproducible --pyproject pyproject.toml -o sbom.json .venv-user/bin/python
	@echo sbom.json

$(BINS)/cyclonedx-py: requirements/sbom.lock requirements/user.lock pyproject.toml
	$(call make-environment,.venv-user,requirements/user.lock)
	$(PYTHON) -m venv .venv-sbom
	$(BINS)/python -m pip install --quiet --requirement requirements/sbom.lock
	@touch $@

clean:
	rm -rf .venv .venv-opencv4 .venv-user .venv-sbom

$(USER_READY): requirements/user.lock pyproject.toml
	$(call make-environment,.venv,requirements/user.lock)
	@touch $@

$(READY): requirements/dev.lock pyproject.toml
	$(call make-environment,.venv,requirements/dev.lock)
	@touch $@ $(USER_READY)

$(READY4): requirements/opencv4.lock pyproject.toml
	$(call make-environment,.venv-opencv4,requirements/opencv4.lock)
	@touch $@

define make-environment
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.12")'
	$(PYTHON) -m venv $(1)
	$(1)/bin/python -m pip install --quiet --requirement $(2)
	$(1)/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable .
endef
