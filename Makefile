# make fly      fly the paper's collision experiment (ARGS='hover --seed 3' for another flight)
# make live     watch a flight in the browser (ARGS=hover, ARGS=runs/flight, ARGS=suite for running nodes)
# make workbench  turn a propeller's knobs in the browser
# make check    lint and the fast tests, in parallel: two minutes
# make test     lint, then every test (PYTEST_ARGS='-k propeller' for some)
# make test-px4 PX4=DIR   fly with a real PX4 SITL that was built in DIR (ARGS='--seeds 50'); ARGS=--losses: lose
#                         poses, link, bridge …, without PX4=DIR over the simulated one; --first-flight:
#                         the guided first flight, with faults
# make lint     ruff and mypy
# make format   lay the sources out as `make lint` wants them
# make bench    measure the speed on this machine
# make docs     regenerate pictures, tables and figures of the documentation (ARGS=campaign for one)
# make site     the documentation as pages that are searched offline, into build/site
# make setup    only make .venv; every other target does it first when needed
# make clean    remove .venv, builds and caches; flights in runs/ stay

BIN := .venv/bin
SETUP := @./scripts/setup.sh

# A sourced ROS or another environment must not leak into .venv.
unexport PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
unexport LD_LIBRARY_PATH VIRTUAL_ENV _ROS_WHEELS_BOOTSTRAP_COMPLETE
# Compiled once, not in every process of every run.
unexport PYTHONDONTWRITEBYTECODE
# What the tests say over DDS stays on this machine.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

.DEFAULT_GOAL := help
.PHONY: help setup fly live workbench check fast-tests test test-px4 lint format bench docs site clean

help:
	@sed -n 's/^# make /make /p' Makefile

setup:
	$(SETUP)
	@echo "ready: $(BIN)/tombo --help"

fly:
	$(SETUP)
	@$(BIN)/tombo fly $(ARGS)

live:
	$(SETUP) --web
	@$(BIN)/tombo live $(ARGS)

workbench:
	$(SETUP) --web
	@$(BIN)/tombo workbench $(ARGS)

PYTEST := $(BIN)/python -m pytest --durations=10 $(PYTEST_ARGS)
LOADFILE := --dist loadfile --no-loadscope-reorder
# One more than cores: who waits for nodes leaves its core to others.
WORKERS := $(shell echo $$(($$(nproc) + 1)))

check:
	$(SETUP) --web
	@$(MAKE) --no-print-directory --jobs=2 --keep-going lint fast-tests

fast-tests:
	@$(PYTEST) -n auto $(LOADFILE) -m "not slow and not nodes and not real_time" --hypothesis-profile=few

# Both parts run, whatever the first says; 5: PYTEST_ARGS leave no test in that part.
test: lint
	$(SETUP) --web
	@parallel=0; alone=0; \
	$(PYTEST) -n $(WORKERS) $(LOADFILE) -m "not real_time" || parallel=$$?; \
	$(PYTEST) -m real_time || alone=$$?; \
	case "$$parallel $$alone" in "0 0" | "0 5" | "5 0") ;; *) exit 1 ;; esac

test-px4:
	$(SETUP)
	@$(BIN)/python -m tombo_benchmarks.px4 $(PX4) $(ARGS)

lint:
	$(SETUP) --no-kernels
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/mypy

format:
	$(SETUP) --no-kernels
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench:
	$(SETUP)
	@$(BIN)/python -m tombo_benchmarks.speed $(ARGS)

docs:
	$(SETUP)
	@$(BIN)/python -m tombo_benchmarks.docs $(ARGS)

site:
	$(SETUP)
	@./scripts/site.sh

clean:
	rm -rf .venv .venv-site build install log .mypy_cache .ruff_cache .pytest_cache .hypothesis
	rm -rf tombo_ws/build tombo_ws/install tombo_ws/log
	find tombo_ws tests -name __pycache__ -prune -exec rm -rf {} +
