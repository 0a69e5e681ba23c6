# make run and make test do everything a newcomer needs. PYTHON names the interpreter the environment is made with.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out/hand_downward
# Kernels for the widest instruction set that this machine runs, and for the baseline that tests compare it with.
# INSTRUCTION_SETS=all compiles the others, too.
INSTRUCTION_SETS ?= own
# The packages of an extra, without building the project once more for them.
EXTRA = $(BIN)/python -c 'import sys, tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"][sys.argv[1]])'
SOURCES := pyproject.toml CMakeLists.txt README.md $(shell find include bindings cmake src -type f -not -name '*.pyc')

.PHONY: build run test lower-bounds validate bench fuzz lint format wheel docs clean

build: $(VENV)/.built

$(VENV)/.created:
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed: make PYTHON=..."; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --upgrade pip
	touch $@

$(VENV)/.built: $(VENV)/.created $(SOURCES)
	@echo "Compiling the kernels ($(INSTRUCTION_SETS) instruction sets): one to three minutes on two cores."
	@rm -rf build/wheels && mkdir -p build/wheels
	@{ $(BIN)/pip wheel --verbose --no-deps --wheel-dir build/wheels \
	    --config-settings=cmake.define.BUMPSTOP_INSTRUCTION_SETS=$(INSTRUCTION_SETS) . 2>&1 || touch build/failed; } \
	    | tee build/build.log | { grep --line-buffered -E '^ *\[ *[0-9]+[%/]' || true; }
	@if [ -e build/failed ]; then rm build/failed; tail -n 40 build/build.log; echo "The whole log: build/build.log"; exit 1; fi
	@echo "Installing bumpstop and what it needs into $(VENV)."
	$(BIN)/pip install --quiet --force-reinstall --no-deps build/wheels/bumpstop-*.whl
	$(BIN)/pip install --quiet build/wheels/bumpstop-*.whl
	touch $@

# The verdict may be "not acceptable" (exit status 3): the job is done all the same.
run: build
	$(BIN)/bumpstop evaluate examples/01_hand_downward.toml --out $(OUT) || [ $$? -eq 3 ]

$(VENV)/.tested: $(VENV)/.built
	$(BIN)/pip install --quiet $$($(EXTRA) test)
	touch $@

# A process for each core, the longest files first (tests/conftest.py); more threads for matrices and tables in each of
# them would only wait for one another. PROFILE=default draws other cases for property tests than those of every run.
# PYTHONDONTWRITEBYTECODE would have every process rewrite the asserts of all tests, ten seconds, in every run.
PROFILE ?= ci
test: $(VENV)/.tested
	PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 POLARS_MAX_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder \
	--hypothesis-profile=$(PROFILE)

# The lowest versions that pyproject.toml allows, in an environment of their own, and of the tests those files that reach
# every one of these packages.
$(VENV)/lowest/.made: $(VENV)/.built pyproject.toml
	rm -rf $(VENV)/lowest
	$(PYTHON) -m venv $(VENV)/lowest
	$(BIN)/python tools/lower_bounds.py > $(VENV)/lowest/constraints.txt
	$(VENV)/lowest/bin/pip install --quiet --constraint $(VENV)/lowest/constraints.txt build/wheels/bumpstop-*.whl $$($(EXTRA) test)
	touch $@

lower-bounds: $(VENV)/lowest/.made
	OPENBLAS_NUM_THREADS=1 $(VENV)/lowest/bin/python -m pytest -n auto --dist loadfile -W default \
	$(addprefix tests/cli/test_,$(addsuffix .py,command completion identify outputs refusals robots study verdict)) \
	tests/contact tests/recording tests/report/test_other_limits.py tests/plant/test_plant.py \
	tests/collision/trajectory/test_trajectory_file.py

validate: $(VENV)/.tested
	BUMPSTOP_ALL_CONTROLS=1 $(BIN)/python -m pytest tests/view/test_controls_in_browser.py
	$(BIN)/python -m validation --out out/validation

# Damaged files for every reader, so many seconds each.
SECONDS ?= 3600
fuzz: $(VENV)/.tested
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m fuzz --seconds $(SECONDS)

bench: $(VENV)/.tested
	$(BIN)/python -m benchmarks

# mypy follows imports into the packages that the tests install.
$(VENV)/.linted: $(VENV)/.tested
	$(BIN)/pip install --quiet $$($(EXTRA) lint)
	touch $@

# Kernels that this processor does not run are checked all the same.
WIDER := $(if $(filter x86_64,$(shell uname -m)),"-mavx2 -mfma" "-mavx512f -mavx512dq -mavx512vl -mavx2 -mfma")
lint: $(VENV)/.linted
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy -p bumpstop
	@if command -v clang-format >/dev/null; then clang-format --dry-run --Werror $$(git ls-files '*.hpp' '*.cpp'); \
	else echo "clang-format is not installed: C++ layout not checked"; fi
	@for compiler in c++ clang++ "clang++ -stdlib=libc++"; do \
	if echo '#include <vector>' | $$compiler -std=c++20 -fsyntax-only -x c++ - 2>/dev/null; then \
	for flags in "" $(WIDER); do \
	$$compiler -std=c++20 -fsyntax-only -Wall -Wextra -Werror -Wno-psabi $$flags -Iinclude -Itests tests/collision/kernels.cpp tests/model/dynamics/dynamics.cpp \
	tests/signal/causal_derivative.cpp tests/signal/zero_phase.cpp tests/joint/joint_torque.cpp || exit 1; done; \
	else echo "$$compiler is not installed: not compiled with it"; fi; done

format: $(VENV)/.linted
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	clang-format -i $$(git ls-files '*.hpp' '*.cpp')

# An sdist and a wheel for each CPython here, with the kernels of all instruction sets, each tried in an empty environment.
wheel:
	$(PYTHON) tools/packages.py

$(VENV)/.documented: $(VENV)/.built
	$(BIN)/pip install --quiet $$($(EXTRA) docs)
	touch $@

# Warnings are errors; then links, requests to other hosts, figures and the search are checked.
docs: $(VENV)/.documented
	@command -v doxygen >/dev/null || echo "doxygen is not installed: the reference of C++ will say so"
	rm -rf build/site
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m sphinx -b html -W --keep-going -q docs build/site
	$(BIN)/python tools/check_site.py build/site

clean:
	rm -rf $(VENV) build dist out docs/made .pytest_cache .mypy_cache .ruff_cache .hypothesis
