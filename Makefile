# busd: `make demo` shows it, `make test` tests it. Everything happens in .venv.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
# The native core (shared memory): auto builds it where that can be done, yes must have it, no goes without.
BUS_NATIVE ?= auto
export BUS_NATIVE
STAMP  := $(VENV)/.busd-$(BUS_NATIVE)
TOOLS  := $(STAMP) $(VENV)/.tools
BENCH_STAMP := $(VENV)/.bench
# ROS 2's own rclpy, of each of its distributions in an environment of its own. Benchmarks need Jazzy only.
PEERS := jazzy kilted zeros
ROS_STAMP := .venv-jazzy/.peers
FUZZ_STAMP := $(VENV)/.fuzz
SOAK_STAMP := $(VENV)/.soak
VISION_STAMP := $(VENV)/.vision
RELEASE_STAMP := $(VENV)/.release
DOCS_STAMP := $(VENV)/.docs
CORE   := setup.py $(wildcard clients/bus/shm/*.[ch] clients/bus_tf2/core/*.[ch] clients/bus_bag/core/*.[ch])
PIP    := $(BIN)/python -m pip install -qq --disable-pip-version-check
SECONDS ?=
SEED ?=
PYTEST_ARGS ?=
# Tests often wait for a process or a period, so four workers a processor keep it busy.
WORKERS ?= $(shell expr 4 \* $$(nproc))
# With bytecode kept: to compile the modules anew in each process costs more than most tests.
PYTEST := PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal
NATIVE_LOG := tests/native/build/short.log
ARM_LOG := tests/native/build/arm.log
ARM_CC := aarch64-linux-gnu-gcc
ARM_TESTS := $(addprefix tests/system/test_c_client,.py _callbacks.py _deadlines.py _graph.py _services.py)

.DEFAULT_GOAL := help

help: ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 15

setup: $(TOOLS) ## make .venv and install busd into it, with the development tools (BUS_NATIVE=yes|no)

$(BIN)/python:
	@echo "making $(VENV): 5 to 30 seconds"
	@$(PYTHON) -m venv $(VENV)

# Where somebody has installed this tree into .venv by hand, and it is no older than its sources, that will do.
BY_HAND = $(wildcard $(VENV)/lib/python*/site-packages/__editable__.busd-*.pth)

# An editable installation names an import hook there, and each start of Python imports pathlib and re for that: as long
# as Python itself takes. The two folders do.
TWO_FOLDERS = for list in $(VENV)/lib/python*/site-packages/__editable__.busd-*.pth; do \
		[ ! -e "$$list" ] || { rm "$$list" && printf '%s\n' "$(CURDIR)/clients" "$(CURDIR)" >"$$list"; }; done

$(STAMP): pyproject.toml $(CORE) | $(BIN)/python
	@if [ $(BUS_NATIVE) != auto ] || [ -e $(VENV)/.busd-no ] || [ -z "$(BY_HAND)" ] \
			|| [ -n "$$(find $^ -newer "$(BY_HAND)")" ]; then \
		echo "installing busd and what it needs into $(VENV): 10 seconds to a minute"; \
		rm -f $(VENV)/.busd-* $(if $(filter no,$(BUS_NATIVE)),clients/bus/shm/*.so clients/bus_tf2/core/*.so clients/bus_bag/core/*.so); \
		$(PIP) --editable . && $(TWO_FOLDERS); \
	fi
	@touch $@

# What an extra of pyproject.toml adds to busd, without installing that again. Of its modules a third is ever imported,
# and compiled then.
EXTRA = $(BIN)/python -c "import tomllib; project = tomllib.load(open('pyproject.toml', 'rb'))['project']; \
	print(*project['optional-dependencies']['$(1)'], sep='\n')" | $(PIP) --no-compile --requirement /dev/stdin

$(VENV)/.tools: pyproject.toml | $(STAMP)
	@echo "installing the development tools into $(VENV): half a minute to three minutes, 200 MB"
	@$(call EXTRA,dev)
	@touch $@

demo: $(STAMP) ## a talker and two listeners, as in the ROS 2 lesson (SECONDS=5 ends by itself)
	@$(BIN)/python examples/demo.py $(SECONDS)

robot: $(STAMP) ## the lesson's robot: perception, cognition, actuation, monitoring (SECONDS=10; C=yes: in C and C++)
	@$(BIN)/python examples/robot/main.py $(if $(filter yes,$(C)),--c) $(SECONDS)

test: $(TOOLS) ## the whole test suite (BUS_NATIVE=no: as without the native core)
	@$(MAKE) --no-print-directory --jobs 2 $(if $(PYTEST_ARGS)$(filter no,$(BUS_NATIVE)),,native) suite

suite: $(if $(PYTEST_ARGS),,compiled)
	$(PYTEST) $(PYTEST_ARGS)

# In a fresh clone pytest compiles the tests: ten seconds, for each worker unless it was done before. If no source has
# changed since, nothing is to be compiled.
COMPILED := $(VENV)/.compiled
compiled: $(TOOLS)
	@if [ ! -e $(COMPILED) ] || [ -n "$$(find tests clients busd -name '*.py' -newer $(COMPILED) -print -quit)" ]; then \
		touch $(COMPILED); \
		PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -q --collect-only -p no:cacheprovider >/dev/null || true; \
	fi

# Each part runs also where another has failed; the last lines say which have.
NIGHTLY = test-nightly test-uptime test-nohup native sanitize arm wheels mutants chaos chaos-bridges chaos-ros2 fuzz soak
nightly: $(TOOLS) ## all that is slow: every test and combination, sanitizers, mutants, chaos, fuzz, soak
	@$(MAKE) --no-print-directory --keep-going --jobs 1 $(NIGHTLY)

test-landing: $(TOOLS) ## slow tests that `test` leaves out, and those of the benchmarks: two minutes
	$(PYTEST) --landing -m landing $(PYTEST_ARGS)

# In asyncio's debug mode, which finds calls from the wrong thread. It costs a tenth of the suite's processor time.
test-nightly: $(TOOLS) $(VISION_STAMP)
	@$(MAKE) --no-print-directory $(DOCS_STAMP) || echo "mkdocs can't be installed: tests of the site say so"
	PYTHONASYNCIODEBUG=1 $(PYTEST) --nightly $(PYTEST_ARGS)

# The clocks of a machine that booted a minute ago: a test must not subtract an hour from them.
test-uptime: $(TOOLS)
	@if ! unshare --fork --time true 2>/dev/null; then \
		echo "unshare --time is not allowed here: the suite was not run at an uptime of 60 s"; \
	else since=$$((60 - $$(cut -d. -f1 /proc/uptime))); \
		unshare --fork --time --monotonic=$$since --boottime=$$since env $(PYTEST) $(PYTEST_ARGS); \
	fi

# As under nohup, cron or a CI runner: signals are ignored, and there is no terminal. Ctrl-C at make ends it, too.
test-nohup: $(TOOLS)
	@setsid --fork --wait setpriv --pdeathsig TERM \
		sh -c 'trap "" INT HUP QUIT; exec "$$@"' sh env $(PYTEST) $(PYTEST_ARGS) </dev/null

$(VISION_STAMP): pyproject.toml | $(TOOLS)
	@echo "installing OpenCV into $(VENV): 10 seconds to a minute, 180 MB"
	@$(call EXTRA,vision) || echo "OpenCV can't be installed: its tests say so"
	@touch $@

mutants: $(TOOLS) ## break lines of the source one at a time, and see that tests fail (ARGS="busd/core qos")
	@PYTHONPATH=tests $(BIN)/python -m mutants $(ARGS)

lint: $(TOOLS) ## style, types, layers, and the wording of the pages
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tests/wording.py

native: ## the ring's C tests, half a minute or more, a part of `test`; nothing where gcc is not there
	@if echo '#include <stdlib.h>' | gcc -E - >/dev/null 2>&1; then \
		mkdir -p $(dir $(NATIVE_LOG)) && $(MAKE) -C tests/native short >$(NATIVE_LOG) 2>&1 \
			|| { cat $(NATIVE_LOG); exit 1; }; \
		echo "the ring's C tests passed, see $(NATIVE_LOG)"; \
	else echo "no gcc: the ring's C tests were left out"; fi

arm: $(TOOLS) ## the ring's C tests and the C client on aarch64, by an emulator; nothing where that or the cross compiler is not there
	@if ! echo '#include <stdlib.h>' | $(ARM_CC) -E - >/dev/null 2>&1; then \
		echo "no $(ARM_CC) with a C library: the tests for aarch64 were left out"; \
		echo "(Debian: apt install gcc-aarch64-linux-gnu libc6-dev-arm64-cross)"; \
	elif ! command -v qemu-aarch64 >/dev/null; then \
		echo "no qemu-aarch64: the tests for aarch64 were left out (Debian: apt install qemu-user)"; \
	else mkdir -p $(dir $(ARM_LOG)) && $(MAKE) -C tests/native arm >$(ARM_LOG) 2>&1 \
			|| { cat $(ARM_LOG); exit 1; }; \
		echo "the ring's C tests passed on aarch64, see $(ARM_LOG)"; \
		BUSD_TEST_CC=$(ARM_CC) BUSD_TEST_EMULATOR=qemu-aarch64 $(PYTEST) $(ARM_TESTS) $(PYTEST_ARGS); \
	fi

sanitize: ## the ring as C programs under the sanitizers, and broken on purpose (needs gcc)
	$(MAKE) -C tests/native test sanitize

differential: $(TOOLS) $(ROS_STAMP) ## programs under ROS 2's own rclpy and under busd's (ARGS="--record timers")
	@PYTHONPATH=tests:. $(BIN)/python -m differential $(ARGS)

fuzz: $(FUZZ_STAMP) ## fuzz all that takes input, guided by coverage (SECONDS=60; atheris, and clang for the C parts)
	PYTHONPATH=tests:tests/world $(BIN)/python -m fuzz --seconds $(or $(SECONDS),60)

# Where atheris can't be had, the fuzzers in Python are left out, and the run says so.
$(FUZZ_STAMP): $(TOOLS)
	@rm -f $@
	@$(call EXTRA,fuzz) && touch $@ \
		|| echo "atheris can't be installed"

docs: $(DOCS_STAMP) ## build the pages as a site, build/site (SERVE=yes: serve it, and build it anew after each change)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs $(if $(SERVE),serve --livereload,build)
	$(if $(SERVE),,@echo "open build/site/index.html in a browser")

$(DOCS_STAMP): pyproject.toml | $(BIN)/python
	@echo "installing mkdocs into $(VENV): 10 seconds to a minute, 130 MB"
	@$(call EXTRA,docs)
	@touch $@

api: $(TOOLS) ## write docs/api.md, docs/protocol-fields.md and docs/assets/frames.json, out of the sources
	@$(BIN)/python tests/apipage.py
	@$(BIN)/python tests/fieldspage.py
	@$(BIN)/python tests/framesfile.py

messages: $(TOOLS) ## write the classes of bus.msg and bus.srv out of clients/bus/share, and their hashes
	@$(BIN)/python tests/messageclasses.py
	@$(BIN)/python tests/describedtypes.py

vendor: $(TOOLS) ## fetch the libraries of the page and of the site once more, by npm (their versions are in tests/vendoring.py)
	@$(BIN)/python tests/vendoring.py

axe: $(TOOLS) ## fetch what tests of the page find faults of access by, by npm
	@test -e $(VENV)/axe.min.js || $(BIN)/python tests/vendoring.py axe

foxglove: $(TOOLS) ## fetch the client of Foxglove's protocol with which tests look at the bus, by npm
	@test -e $(VENV)/foxglove/node_modules/ws || $(BIN)/python tests/vendoring.py foxglove

fmt: $(TOOLS) ## format the sources
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench-quick: $(BENCH_STAMP) $(ROS_STAMP) ## latency, throughput, fan-out, cost, start ... beside rivals, about two minutes
	$(BIN)/python -m benchmarks --quick

bench: $(BENCH_STAMP) $(ROS_STAMP) ## the same, longer: about an hour (ARGS="--only bags --into benchmarks/results/....json")
	$(BIN)/python -m benchmarks $(ARGS)

chaos: $(TOOLS) ## kill, stop, cut off and starve the processes of a bus, and see what holds (SECONDS=60 SEED=7)
	@PYTHONPATH=tests $(BIN)/python -m chaos --seconds $(or $(SECONDS),60) $(if $(SEED),--seed $(SEED))

chaos-bridges: $(TOOLS) ## the same of two buses and what joins them: bridges, busds and a cable (KILLS=200 SEED=7)
	@PYTHONPATH=tests $(BIN)/python -m chaos.bridges --kills $(or $(KILLS),200) $(if $(SEED),--seed $(SEED))

chaos-ros2: $(TOOLS) ## the same of calls between a bus and a node of rclpy, which `make peers` installs (KILLS=30 SEED=7)
	@PYTHONPATH=tests $(BIN)/python -m chaos.ros2 --kills $(or $(KILLS),30) $(if $(SEED),--seed $(SEED))

soak: $(SOAK_STAMP) ## a steady load: memory and descriptors flat, latency over time (MINUTES=30)
	$(BIN)/python -m benchmarks.soak --minutes $(or $(MINUTES),30)

# Where matplotlib can't be had, there is no picture, and the run says so.
$(SOAK_STAMP): $(TOOLS)
	@rm -f $@
	@$(call EXTRA,soak) && touch $@ \
		|| echo "matplotlib can't be installed"

bench-compare: $(TOOLS) ## what changed from one result to another (A=one.json B=other.json)
	$(if $(and $(A),$(B)),,$(error say which: make bench-compare A=one.json B=other.json))
	@$(BIN)/python -m benchmarks.compare $(A) $(B)

bench-report: $(BENCH_STAMP) ## the report, its tables and pictures, and the README's table (RESULT=benchmarks/results/....json)
	$(if $(RESULT),,$(error say of which: make bench-report RESULT=benchmarks/results/....json))
	$(BIN)/python -m benchmarks.write $(RESULT)

peers: $(PEERS:%=.venv-%/.peers) ## ROS 2's own rclpy into .venv-jazzy and .venv-kilted: half a minute or more and 270 MB each, x86_64; pyzeros into .venv-zeros

# Its modules have the names of busd's facade, so it is kept apart. Where it can't be had, what needs it says so.
.venv-%/.peers: benchmarks/%.txt | $(TOOLS)
	@echo "installing a peer ($*) into .venv-$*: half a minute to three minutes, 270 MB at most"
	@mkdir -p $(@D)
	@{ $(BIN)/python -m venv $(@D) \
			&& $(@D)/bin/python -m pip install -qq --disable-pip-version-check --no-compile --requirement $< \
			$(if $(filter zeros,$*),&& CYDR_CACHE_DIR=$(CURDIR)/$(@D)/codecs $(@D)/bin/python tests/peers/programs/zeros.py); } \
		|| echo "the peer ($*) can't be installed (rclpy has packages for x86_64 and Python 3.10 to 3.14 only):" \
			"what needs it says so"
	@touch $@

# What is measured beside busd. Where it can't be had, its rows say so, and the rest is measured.
$(BENCH_STAMP): $(TOOLS) $(wildcard benchmarks/c/*.[ch] benchmarks/c/Makefile clients/c/*/*.[ch] clients/c/*/*/*.h clients/bus/shm/*.h)
	@rm -f $@
	@$(call EXTRA,bench) && touch $@ \
		|| echo "the rivals can't be installed: the rows of those that are not there say so"
	@$(MAKE) --no-print-directory -C benchmarks/c BUS=$(abspath $(BIN))/bus \
		|| { rm -f $@; echo "the programs in C can't be built: their rows say so"; }

wheels: $(RELEASE_STAMP) ## sdist, pure and native wheel into dist/, each checked and used with every Python found
	@PYTHONPATH=tests $(BIN)/python -m wheels

test-pythons: $(RELEASE_STAMP) ## the unit and shared memory tests with every Python found (VERSIONS="3.12 3.13" or others)
	@PYTHONPATH=tests $(BIN)/python -m pythons $(VERSIONS)

# Each part runs even if another fails; the last lines say which have.
# `test` compares the version with the changelog and the pages with what they describe, `wheels` the packages with the
# version, and has twine check their page.
RELEASE = lint test wheels test-pythons sanitize arm
release-check: $(TOOLS) ## all that must pass before a release: lint, tests, packages, other Pythons, sanitizers
	@$(MAKE) --no-print-directory --keep-going --jobs 1 $(RELEASE)
	@echo "ready for release: $(RELEASE) passed"

$(RELEASE_STAMP): pyproject.toml | $(TOOLS)
	@echo "installing what makes and checks packages into $(VENV): 10 seconds to a minute"
	@$(call EXTRA,release)
	@touch $@

clean: ## remove what the other targets made
	rm -rf $(VENV) $(PEERS:%=.venv-%) build dist tests/native/build benchmarks/c/build clients/bus/shm/*.so clients/bus_tf2/core/*.so clients/bus_bag/core/*.so *.egg-info .mypy_cache .pytest_cache .ruff_cache .hypothesis .fuzz .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.PHONY: help setup demo robot docs test suite compiled nightly test-nightly test-uptime test-nohup mutants native arm lint sanitize differential fuzz api messages vendor axe foxglove fmt bench-quick bench peers chaos chaos-bridges chaos-ros2 soak bench-compare bench-report wheels test-pythons release-check clean
