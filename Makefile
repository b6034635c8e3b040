# make run    installs, builds, migrates and starts Sinew on the simulator; prints the sign-in link
# make test   installs what the tests need (a browser too) and runs what each change has to pass, in lanes: tests/lanes.py
# Further: check, format, test-thorough (all tests, for a version), test-newest (the tests on the newest Python), fuzz (junk at every door), bench, soak (attacks and long runs),
# mutate (whether the tests notice when something is computed wrongly; an hour),
# figures (the tables of the documents, computed anew), screenshots, lock (the newest packages that pyproject.toml allows, with their hashes). Everything made stays in .venv, .venv-newest, .cache, frontend/node_modules and backend/static.
# ARGS goes to sinew serve, pytest, the soak or the mutants; EXTRAS=rig or postgres adds what these need, from the first install on.

VENV := .venv
BIN := $(VENV)/bin
NPM := $(BIN)/python frontend/build.py
ARGS ?=
EXTRAS ?=
# What is imported is compiled to bytecode once, whatever is set for this shell: all that starts later starts sooner.
unexport PYTHONDONTWRITEBYTECODE
# Generated requests for each operation and kind of token, and the seed that they are made from.
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

# The types of the interface, for an editor and for tsc: they are not committed.
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

# A stamp per set of packages: a second make finds it newer than its sources and goes straight on.
install: $(VENV)/.installed
install-dev: $(VENV)/.installed-dev
install-newest: install-dev frontend
	$(MAKE) --no-print-directory VENV=.venv-newest install-dev

LOCKS := $(wildcard .ci/locks/*.lock)

$(VENV)/.installed: pyproject.toml .ci/install.py $(LOCKS) | $(BIN)/pip
	@echo "Installing Sinew into $(VENV); the first time this takes half a minute"
	$(BIN)/python .ci/install.py $(EXTRAS)
	@touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
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

# What only the checks and tests of the page need.
packages: install-dev
	@$(NPM) packages
