# Both `make reproduce-tables` and `make test` work from a bare clone: they build .venv first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
EXPERIMENTS := $(filter-out experiments/_%,$(wildcard experiments/*.yaml))

# One BLAS thread per process: the batch over runs is what runs in parallel.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1

.PHONY: install reproduce-tables reproduce-quick check-results check-machines pack-results test lint types unit bench clean

install: $(VENV)/.run

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	touch $@

$(VENV)/.dev: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $@ $(VENV)/.run

# particles 0.4 declares numpy < 2 but works with numpy 2; the extra names what it needs.
$(VENV)/.bench: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps 'particles==0.4'
	touch $@ $(VENV)/.run

# Lists at last which verdicts and which numbers of experiments/README.md are other ones now.
reproduce-tables: $(VENV)/.run
	@$(BIN)/trackbench run $(EXPERIMENTS)
	@$(BIN)/trackbench report results
	@git diff --no-color -U0 -- results/README.md | grep '^[-+]|' || true
	@$(BIN)/python -m tests.prose || true

# Without three studies beyond the papers, which would take a third of the time; figures as in the report.
QUICK := $(filter-out %/adaptive-kf-mfq.yaml %/adaptive-kf-tuned.yaml %/banana-rivals.yaml,$(EXPERIMENTS))
reproduce-quick: $(VENV)/.run
	@$(BIN)/trackbench run $(QUICK) --quick --format svg --out build/quick

# Fails if a published number was changed, or anything stored differs by more than another machine's rounding.
check-results: $(VENV)/.run
	@set -e; for copy in results/*/published/*.csv; do \
	  cmp "$$copy" "experiments/published/$$(basename "$$copy")"; done
	@$(BIN)/trackbench verify $(patsubst %/config.yaml,%,$(wildcard results/*/config.yaml))

# Fails if another processor's kernels, as far as this one can show them, or two workers, give other bytes.
check-machines: $(VENV)/.dev
	$(BIN)/python -m tests.machines --runs 20 --block 20 $(EXPERIMENTS)

# What git keeps of the large files: the commands read them packed as well.
pack-results: $(VENV)/.run
	$(BIN)/python -m trackbench.experiment.storing.packing results/*/

test: lint types unit

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	$(BIN)/mypy

unit: $(VENV)/.dev
	$(BIN)/pytest

bench: $(VENV)/.bench
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) build .mypy_cache .ruff_cache .pytest_cache
