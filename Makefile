# Every target sets up what it needs, once: a virtual environment in .venv with the versions of constraints.txt, and the
# system libraries that Open3D loads (tools/setup.sh). Settings are given on the command line, as in `make run WORKERS=2`.
READY := .venv/.ready
BIN := .venv/bin
PYTEST_ARGS ?= --numprocesses logical --maxprocesses 4

# A virtual environment holds its own path: where the folder was moved or copied, or its Python is gone, it is made anew.
$(shell [ -x $(BIN)/python ] && [ "$$(cat $(READY))" = "$$(pwd -P)" ] || rm -f $(READY))

ifeq ($(filter run,$(MAKECMDGOALS))$(DATASET),run)
$(error say which data set, as in: make run DATASET=roboart SEQUENCES=bolt,ur5)
endif

.DEFAULT_GOAL := help
.PHONY: help setup browser run test lint check format constraints clean

help: ## List the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' Makefile

# make hands the settings on in the environment, so that the shell need not quote them anew.
run: $(READY) ## Fit a data set: DATASET=roboart [SEQUENCES=a,b] [WORKERS=N] [DATA=DIR] [ASSETS=DIR] [WORKDIR=DIR] [ARGS=...]
	@$(BIN)/reart run --dataset "$$DATASET" $(if $(SEQUENCES),--sequences "$$SEQUENCES") $(if $(WORKERS),--workers "$$WORKERS") \
	    $(if $(DATA),--data "$$DATA") $(if $(ASSETS),--assets "$$ASSETS") $(if $(WORKDIR),--workdir "$$WORKDIR") $(ARGS)

setup: $(READY) ## Only set up .venv

browser: ## Only see to a Chromium, which the tests of report.html drive; they are skipped where none is to be had
	@bash tools/browser.sh

test: $(READY) browser ## Run the tests [PYTEST_ARGS=...]
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest $(PYTEST_ARGS)

lint: $(READY) ## Check style, types and the direction of imports
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

check: lint test ## What CI runs

format: $(READY) ## Format the code and fix what ruff can
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

constraints: ## Pin anew, in constraints.txt, the newest versions that pyproject.toml allows (torch stays: edit its line)
	bash tools/renew_constraints.sh

clean: ## Remove .venv and all that tools left; artifacts in workdir/ stay
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis build dist *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(READY): pyproject.toml constraints.txt tools/setup.sh tools/system_packages.sh
	@bash tools/setup.sh
