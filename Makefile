# make run    installs, builds, migrates and starts Sinew on the simulator, and prints the sign-in link
# make test   installs the test dependencies (including a browser) and runs the tests that every change must pass, in
#             parallel lanes (tests/lanes.py)
#
# Further targets:
#   check          linters and type checkers
#   format         formatters
#   test-thorough  all tests, before a release
#   test-newest    the tests on the newest supported Python
#   fuzz           random requests to all API operations
#   bench          benchmarks
#   soak           attacks and long runs
#   mutate         mutation tests of the numerical code; takes an hour
#   figures        recompute the tables of the documentation
#   screenshots    renew the screenshots of the documentation
#   lock           pin the newest packages that pyproject.toml allows, with their hashes
#
# All output stays in .venv, .venv-newest, .cache, frontend/node_modules and backend/static. ARGS is passed to sinew
# serve, pytest, soak or mutate. EXTRAS=rig or EXTRAS=postgres installs optional dependencies, later as well.

VENV := .venv
BIN := $(VENV)/bin
NPM := $(BIN)/python frontend/build.py
ARGS ?=
EXTRAS ?=
# Bytecode is cached regardless of the environment of the shell, so that later starts are faster.
unexport PYTHONDONTWRITEBYTECODE
# Number of generated requests per operation and kind of token, and the seed of the generator.
EXAMPLES ?= 120
SEED ?= 1

.PHONY: run test test-thorough test-newest fuzz check format bench soak mutate figures screenshots lock install install-dev install-newest frontend packages types

run: install frontend
	$(BIN)/sinew serve --plant simulator --params lab $(ARGS)

test: install-dev frontend packages
	.ci/provide browser compose postgres
	$(BIN)/python -m tests.lanes --beside "$(NPM) test" $(ARGS)

test-thorough:
	.ci/provide proxy
	$(MAKE) --no-print-directory test ARGS="--thorough $(ARGS)"

test-newest: install-newest
	.ci/provide browser compose postgres
	.venv-newest/bin/python -m tests.lanes $(ARGS)

fuzz: install-dev frontend
	FUZZ_EXAMPLES=$(EXAMPLES) FUZZ_SEED=$(SEED) $(BIN)/python -m pytest tests/fuzz $(ARGS)

check: install-dev packages
	$(BIN)/python .ci/lock.py --check
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/python -m backend.api.export --check frontend/src/wire
	$(NPM) check

# Types of the API for editors and tsc; not committed.
types: install-dev packages
	$(BIN)/python -m backend.api.export frontend/src/wire
	$(NPM) types

format: install-dev
	$(BIN)/ruff format
	$(BIN)/ruff check --fix
	$(BIN)/python -m backend.api.export frontend/src/wire
	$(NPM) types
	$(NPM) format

bench: install-dev frontend
	.ci/provide browser
	$(BIN)/python -m tests.bench

soak: install-dev frontend
	.ci/provide browser
	$(BIN)/python -m tests.soak $(ARGS)

mutate: install-dev
	$(BIN)/python -m tests.mutate $(ARGS)

figures: install-dev
	$(BIN)/python -m tests.docs.figures --write $(ARGS)

screenshots: install-dev frontend
	.ci/provide browser
	$(BIN)/python -m tests.e2e.screenshots

# One stamp file per set of packages: make skips an installation whose stamp is newer than its sources.
INSTALLED := $(VENV)/.installed$(if $(EXTRAS),-with-$(EXTRAS))
install: $(INSTALLED)
install-dev: $(VENV)/.installed-dev
install-newest: install-dev frontend
	$(MAKE) --no-print-directory VENV=.venv-newest install-dev

LOCKS := $(wildcard .ci/locks/*.lock)

$(INSTALLED): pyproject.toml .ci/install.py $(LOCKS) | $(BIN)/pip
	@echo "Installing Sinew into $(VENV); the first time this takes half a minute"
	$(BIN)/python .ci/install.py $(EXTRAS)
	@touch $@

$(VENV)/.installed-dev: $(INSTALLED)
	@echo "Installing what the tests and checks need"
	$(BIN)/python .ci/install.py dev,rig,postgres,cluster,foxglove
	@touch $@

lock: install
	$(BIN)/python .ci/lock.py

.venv/bin/pip:
	.ci/provide venv

.venv-newest/bin/pip:
	.ci/provide newest

frontend: install
	@$(NPM) build

# Packages that only the checks and tests of the page need.
packages: install-dev
	@$(NPM) packages
