# busd: `make demo` shows it, `make test` tests it. Everything happens in .venv.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
SECONDS ?=
PYTEST_ARGS ?=

.DEFAULT_GOAL := help

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 12

setup: $(STAMP) ## make .venv and install busd into it, with the development tools
$(STAMP): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -qq --disable-pip-version-check --upgrade pip
	$(BIN)/python -m pip install -qq --disable-pip-version-check --editable '.[dev]'
	@touch $@

demo: $(STAMP) ## a talker and two listeners, as in the ROS 2 lesson (SECONDS=5 ends by itself)
	@$(BIN)/python examples/demo.py $(SECONDS)

robot: $(STAMP) ## the lesson's robot: perception, cognition, actuation, monitoring (SECONDS=10)
	@$(BIN)/python examples/robot/main.py $(SECONDS)

test: $(STAMP) ## the whole test suite
	PYTHONASYNCIODEBUG=1 $(BIN)/python -m pytest $(PYTEST_ARGS)

lint: $(STAMP) ## style, types and layers
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

sanitize: ## the ring of the coming shared-memory route, as C programs under the sanitizers (needs gcc)
	$(MAKE) -C tests/native test sanitize

fmt: $(STAMP) ## format the sources
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench-quick: $(STAMP) ## throughput, latency, start, idle and checking, about two minutes
	$(BIN)/python -m benchmarks --quick

bench: $(STAMP) ## the same, longer
	$(BIN)/python -m benchmarks

clean: ## remove what the other targets made
	rm -rf $(VENV) build *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.PHONY: help setup demo robot test lint sanitize fmt bench-quick bench clean
