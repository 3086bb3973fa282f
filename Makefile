# Both commands need Python 3.11 to 3.13 with pip; everything else goes into .venv, once.
#   make replay     the first result: a five-finger grasp of the Stanford bunny
#   make test       style, types, tests, and the gate on errors and work
#   make site       the documentation as a site, in site/
#   make wheel      a wheel with its kernels compiled, in dist/
#   make sdist      the sources as a distribution, in dist/;  make check-dist  checks what lies there
#   make gallery    the films, tables and page of docs/gallery.md
#   make soak       tests that repeat at length what make test has shown
# Another interpreter: make test PYTHON=python3.12

PYTHON ?= python3
# One more than two processors: many tests wait for a process that they started.
PYTEST_OPTIONS ?= -n 3
BIN := .venv/bin

# Bytecode of what is imported is written at its first import; pip's of everything would take a third of its time. The
# tests start hundreds of processes, so that a shell which forbids bytecode would have each compile its own.
# The pip of $(PYTHON) installs into .venv, whose own comes last: to unpack and compile that first takes five seconds.
PIP := $(PYTHON) -m pip --python .venv install --disable-pip-version-check --quiet --no-compile -c constraints.txt
unexport PYTHONDONTWRITEBYTECODE
# Kernels are compiled as soon as this is there.
KERNELS_NEED := numpy numba h5py msgspec
# What a replay imports besides; the rest, nine tenths of the bytes, comes after the first result.
REPLAY_NEEDS := click rich

# A live session and what tells of its machine need Linux; the rest has types that hold on macOS too.
LINUX_ONLY := '/(live|cpu_accounts\.py)(/|$$)'

.PHONY: replay test site gallery soak wheel sdist check-dist checks platforms kernels collected tests own-gate gate clean

# Kernels are compiled while the rest is installed.
replay:
	@$(MAKE) --no-print-directory -j 2 .venv/compiled.stamp .venv/replay.stamp
	$(BIN)/hhsim replay
	@$(MAKE) --no-print-directory .venv/hhsim.stamp

test:
	@$(MAKE) --no-print-directory -j 2 .venv/compiled.stamp .venv/hhsim.stamp
	@$(MAKE) --no-print-directory -j 2 checks kernels collected
	@$(MAKE) --no-print-directory tests own-gate

soak: .venv/test.stamp
	@$(MAKE) --no-print-directory kernels platforms
	$(BIN)/python -m pytest $(PYTEST_OPTIONS) -m soak

gallery: .venv/hhsim.stamp
	$(BIN)/python -m tools.gallery

site: .venv/docs.stamp
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet
	@echo 'site/ has it; to read it here: $(PYTHON) -m http.server -d site'

wheel: .venv/test.stamp
	$(BIN)/python -m tools.build_wheel

sdist: .venv/release.stamp
	$(BIN)/python -m build --sdist

check-dist: .venv/release.stamp
	$(BIN)/twine check --strict dist/*
	for wheel in dist/*.whl; do if [ -e "$$wheel" ]; then $(BIN)/check-wheel-contents "$$wheel"; fi; done

platforms: .venv/test.stamp
	$(BIN)/mypy --platform darwin --follow-imports silent --exclude $(LINUX_ONLY) hhsim cli

checks: .venv/test.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

kernels:
	$(BIN)/python tests/compile_kernels.py

# Once, beside the type checker, or each process of the tests would compile all of them; what fails here fails there.
collected: .venv/test.stamp
	-$(BIN)/python -m pytest --collect-only --quiet >/dev/null

tests:
	$(BIN)/python -m pytest $(PYTEST_OPTIONS)

own-gate:
	$(BIN)/hhsim gate --no-time

gate: kernels
	@$(MAKE) --no-print-directory own-gate

.venv/python.stamp:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' || \
	{ echo 'hhsim needs Python 3.11 to 3.13 and "$(PYTHON)" is not: name one, such as make PYTHON=python3.12' >&2; exit 1; }
	$(PYTHON) -m venv --without-pip .venv
	@touch $@

.venv/kernels.stamp: .venv/python.stamp pyproject.toml constraints.txt
	$(PIP) $(KERNELS_NEED)
	@touch $@

# A kernel that is not compiled here is compiled by the run.
.venv/compiled.stamp: .venv/kernels.stamp
	-$(BIN)/python -m tools.compile_ahead
	@touch $@

.venv/replay.stamp: .venv/kernels.stamp
	$(PIP) $(REPLAY_NEEDS)
	$(PIP) --no-deps -e .
	@touch $@

.venv/hhsim.stamp: .venv/replay.stamp
	$(PIP) hhsim pip
	@touch $@

# By its name, hhsim is found installed and left as it is: kernels are compiled by it meanwhile.
.venv/test.stamp: .venv/hhsim.stamp
	$(PIP) 'hhsim[test,lint]'
	@touch $@

.venv/docs.stamp: .venv/hhsim.stamp
	$(PIP) 'hhsim[docs]'
	$(PIP) --no-deps sphinx-mathjax-offline  # for the MathJax in it; Sphinx is not used
	@touch $@

.venv/release.stamp: .venv/test.stamp
	$(PIP) 'hhsim[release]'
	@touch $@

clean:
	rm -rf .venv build dist site hhsim.egg-info .pytest_cache .mypy_cache .ruff_cache
