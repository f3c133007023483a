# make serve   everything from a fresh machine to the app with embedded data at a printed address
# make test    the same environment, then the whole suite, browser tests included, in two processes

PYTHON ?= python3
PORT ?= 5006
ADDRESS ?= 127.0.0.1
BIN := .venv/bin
READY := .venv/ready

.PHONY: serve test lint benchmarks chromium

serve: $(READY)
	$(BIN)/python -m dashboards --address $(ADDRESS) --port $(PORT)

test: $(READY) chromium
	$(BIN)/python -m pytest --numprocesses 2 --dist loadgroup

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

benchmarks: $(READY) chromium
	for bench in tests/benchmarks/bench_*.py tests/benchmarks/study_*.py; do echo "== $$bench"; $(BIN)/python $$bench || exit 1; done

chromium:
	@sh tests/find_chromium.sh > /dev/null

# The environment, made once and again whenever a pin changes; its last step compiles the kernels.
$(READY): environment.txt pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or later is needed; try make PYTHON=python3.11")'
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r environment.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	$(BIN)/python -c 'from trackerlib.compiled import warm; warm()'
	touch $@

# Remakes the pins from pyproject.toml (needs uv).
environment.txt.new: pyproject.toml
	{ echo '# Every package pinned, for Python 3.11 and later (pip install -r environment.txt).'; \
	  echo '# Remade from pyproject.toml with: make environment.txt.new, then moved here.'; \
	  uv pip compile --universal --python-version 3.11 --extra test --no-header --no-annotate pyproject.toml; } > $@
