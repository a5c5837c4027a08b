# Both `make reproduce-tables` and `make test` work from a bare clone: they build .venv first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
EXPERIMENTS := $(filter-out experiments/suites/%,$(wildcard experiments/*/*.yaml))

# One BLAS thread per process: the batch over runs is what runs in parallel.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
# Else every program that the tests start compiles the package anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: install suite reproduce reproduce-tables reproduce-quick picture check-results check-machines record-times test test-fast lint types unit \
  sanitize lowest wheel lock docs bench audit clean

install: $(VENV)/.run

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

# What is installed is named by requirements/*.txt to the byte, the build's tools included.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
ITSELF := --no-deps --no-build-isolation -e .
# pip would compile on one processor, and the packages' own tests, too.
COMPILE_PACKAGES := $(BIN)/python -m compileall -q -j 0 -x '/tests/' $(VENV)/lib

$(VENV)/.run: pyproject.toml requirements/run.txt trackbench/core/_compiled.c | $(BIN)/python
	$(PIP) --no-compile --require-hashes -r requirements/run.txt
	$(COMPILE_PACKAGES)
	$(PIP) $(ITSELF)
	touch $@

$(VENV)/.dev: pyproject.toml requirements/dev.txt trackbench/core/_compiled.c | $(BIN)/python
	$(PIP) --no-compile --require-hashes -r requirements/dev.txt
	$(COMPILE_PACKAGES)
	$(PIP) $(ITSELF)
	touch $@ $(VENV)/.run

# particles 0.4 declares numpy < 2 but works with numpy 2, DAPPER wants notebooks that it does not use; the extra
# names what they need.
$(VENV)/.bench: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps 'particles==0.4' 'dapper==1.7.1'
	touch $@ $(VENV)/.run

# Runs the suites, below an hour on two cores: their scores stand in results/ (docs/which-filter.md).
SUITES := standard noise settings
suite: $(VENV)/.run
	@for name in $(SUITES); do $(BIN)/trackbench suite $$name --format svg || exit 1; done
	@git status --short -- $(addprefix results/,$(SUITES)) || true

# `make reproduce-tables` runs the experiments on the three papers, `make reproduce` the others and the suite, too.
# Both list the verdicts that changed and the quoted numbers that are stale. A clean `git status` afterwards is the check:
# git keeps what every machine writes alike.
PAPERS := $(wildcard $(foreach paper,adaptive-kf banana hdepf,experiments/$(paper)/*.yaml))
reproduce-tables: CHOSEN := $(PAPERS)
reproduce: CHOSEN := $(EXPERIMENTS)
reproduce: suite
reproduce reproduce-tables: $(VENV)/.run
	@$(BIN)/trackbench run $(CHOSEN) --format svg
	@$(BIN)/trackbench report results
	@git diff --no-color -U0 -- 'results/*/comparison.md' | grep '^[-+]|' || true
	@$(BIN)/python -m tests.prose || true
	@git status --short -- results experiments || true

# Without four studies beyond the papers, which would take a third of the time; figures as in the report.
QUICK := $(filter-out %/adaptive-kf-mfq.yaml %/adaptive-kf-tuned.yaml %/adaptive-kf-tuned-paths.yaml %/banana-rivals.yaml,$(EXPERIMENTS))
reproduce-quick: $(VENV)/.run
	@$(BIN)/trackbench run $(QUICK) --quick --format svg --out build/quick

# The picture of README.md: three filters of an experiment on one panel.
picture: $(VENV)/.run
	$(BIN)/trackbench run radar-turns --out build/turns --format svg \
	  --only EKF --only 'CKF (CT)' --only 'IMM, CKF' --set 'figures.position.filters=[EKF, CKF (CT), "IMM, CKF"]' \
	  --set 'figures.position.title=An aircraft turns between 120 and 180 s and between 260 and 305 s'
	cp build/turns/figures/position.svg docs/pictures/turns.svg

# Fails if a published number was changed, or anything stored differs by a byte from what is computed again.
# In a clone, which has digests in place of the runs, it recomputes all runs.
check-results: $(VENV)/.run
	@set -e; for copy in results/*/published/*.csv; do \
	  cmp "$$copy" experiments/*/published/"$$(basename "$$copy")"; done
	@$(BIN)/trackbench verify $(patsubst %/config.yaml,%,$(wildcard results/*/config.yaml))

# Fails if another processor's kernels, as far as this one can show them, or two workers, give other bytes.
check-machines: $(VENV)/.dev
	$(BIN)/python -m tests.machines --runs 20 --block 20 $(EXPERIMENTS)

# Replaces the CPU times that docs and verdicts quote, in results/times/, by those of the last runs on this machine.
record-times: $(VENV)/.run
	@for name in $(SUITES); do $(BIN)/trackbench suite $$name --quick --format svg || exit 1; done
	@$(BIN)/trackbench suite standard --quick --problem lorenz96-40 --problem linear --format svg
	$(BIN)/python -m tests.times

# The types beside the tests, whose last file leaves a core idle.
test: lint
	@$(MAKE) --no-print-directory -j 2 types unit

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	$(BIN)/mypy

# A file's tests share what they compute, so a worker takes a file whole, in the order of tests/conftest.py.
PYTEST := pytest -n auto --dist loadfile --no-loadscope-reorder

unit: $(VENV)/.dev
	$(BIN)/$(PYTEST)

# Without types and without the tests that took more than 0.2 s when they last ran, for use while working.
test-fast: lint
	$(BIN)/$(PYTEST) --fast

# The C kernels under the sanitizers of addresses and undefined behavior, in a copy; needs GCC on Linux.
SANITIZED := build/sanitized
sanitize: $(VENV)/.dev
	rm -rf $(SANITIZED)
	mkdir -p $(SANITIZED)
	cp -r trackbench tests docs experiments pyproject.toml README.md $(SANITIZED)
	rm -f $(SANITIZED)/trackbench/core/_compiled.abi3.so
	cd $(SANITIZED) && CC='gcc -g -fsanitize=address,undefined -fno-sanitize-recover=all' \
	  $(CURDIR)/$(BIN)/python trackbench/core/build_compiled.py
	cd $(SANITIZED) && LD_PRELOAD=$$(gcc -print-file-name=libasan.so) ASAN_OPTIONS=detect_leaks=0 PYTHONPATH=. \
	  $(CURDIR)/$(BIN)/python -m pytest -s -p no:xdist -p no:cacheprovider tests/core

# The tests with the lowest versions that pyproject.toml allows, in an environment of their own.
lowest:
	$(MAKE) VENV=build/lowest unit-lowest

.PHONY: unit-lowest
unit-lowest: $(BIN)/python
	$(PIP) -c requirements/lowest.txt -e '.[dev]'
	$(BIN)/$(PYTEST)

wheel: $(VENV)/.dev
	$(BIN)/python -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist .

# Newest versions, the same on every system and Python; needs uv (pip install uv).
UV := uv
COMPILE := $(UV) pip compile --quiet --universal --python-version 3.11 --no-annotate \
  --custom-compile-command "make lock" pyproject.toml
HASHED := $(COMPILE) - --fork-strategy fewest --generate-hashes --upgrade

lock:
	echo hatchling | $(HASHED) -o requirements/run.txt >/dev/null
	echo hatchling | $(HASHED) --extra dev -c requirements/run.txt -o requirements/dev.txt >/dev/null
	$(COMPILE) --resolution lowest-direct --upgrade -o requirements/lowest.txt >/dev/null

# The site, in build/site/; opened as files it needs no server and no net.
docs: $(VENV)/.dev
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet -f docs/mkdocs.yml

# In an environment of its own: the peers bring plugins of pytest that warn, and warnings fail our tests.
bench:
	$(MAKE) VENV=build/bench measure

.PHONY: measure
measure: $(VENV)/.bench
	$(BIN)/python -m benchmarks

# Judges the filters of other packages, in an environment of their own (docs/findings/audit.md).
RELEASES := build/audit-releases
audit:
	$(MAKE) VENV=build/audit judge

.PHONY: judge
judge: $(BIN)/python
	$(PIP) -e . -r benchmarks/audit/requirements.txt
	grep -v '^#' benchmarks/audit/releases.txt | while read -r one; do \
	  $(PIP) --no-deps --upgrade --target "$(RELEASES)/$$one" "$$one"; done
	$(BIN)/python -m benchmarks.audit

clean:
	rm -rf $(VENV) build .mypy_cache .ruff_cache .pytest_cache
