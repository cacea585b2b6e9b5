# Each target does all the set-up that it needs, once; the second time there is nothing to do.
# Only "make debian-packages" installs anything outside the checkout.

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install -c constraints.txt
# Where none is given: that of the environment that is there, else the first one that fits.
PYTHON_FITS := import sys, ensurepip; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))
PYTHON_VERSION := import sys; print(sys.version.split()[0])
ifndef PYTHON
PYTHON := $(shell for p in $(BIN)/python python3 python3.13 python3.12 python3.11 python3.14; do \
	$$p -c "$(PYTHON_FITS)" 2>/dev/null && echo $$p && break; done)
endif
# An environment of another version than that of PYTHON is made anew.
version_of = $(shell "$(1)" -c '$(PYTHON_VERSION)' 2>/dev/null)
ifneq ($(call version_of,$(PYTHON)),$(call version_of,$(BIN)/python))
OTHER_PYTHON := other-python
endif
# The Pythons for which "make soak" installs the wheel, each in an environment of its own.
PYTHONS ?= python3.11 python3.12 python3.13 python3.14

# OpenGL for the viewer; a virtual screen and simulated input for the tests of its window.
OPENGL_PACKAGES := libgl1 libglx-mesa0 libgl1-mesa-dri libegl1 libegl-mesa0 libx11-6
SCREEN_PACKAGES := xvfb xauth xdotool

# Without a display, the demo drags the top by this much (model space) instead of you.
DEMO_DRAG ?= top:0.15,-0.1,-0.05
DEMO_FRAMES ?= 90
WINDOW_OPENS := import pyglet; config = pyglet.gl.Config(major_version=3, minor_version=3); \
	pyglet.window.Window(8, 8, visible=False, config=config)

PYTEST_ARGS ?=

# Kernels are compiled once and cached under HOME, or in the checkout where HOME can't be written.
CACHE_FITS = test -n "$$HOME" && c="$${XDG_CACHE_HOME:-$$HOME/.cache}" && mkdir -p "$$c" && test -w "$$c"
ifneq ($(shell ($(CACHE_FITS)) 2>/dev/null && echo yes),yes)
export XDG_CACHE_HOME := $(CURDIR)/.cache
export WARP_CACHE_PATH := $(CURDIR)/.cache/warp
endif

.PHONY: other-python help demo test soak random-use lint kernels venv debian-packages

help:
	@echo "make demo   open the bundled model (set-up included: what viewing needs)"
	@echo "make test   run the tests (set-up included; PYTEST_ARGS='-k camera' for some of them)"
	@echo "make soak   run the tests with new random inputs, read damaged files, kill commands (forty minutes more)"
	@echo "make random-use   a million frames of random use of the solver (some ten minutes)"
	@echo "make lint   check style and formatting"
	@echo "make kernels   compile the CUDA kernels that are shipped compiled, after a change of them"
	@echo "make venv   set-up alone: $(VENV) with everything, in the versions of constraints.txt"
	@echo "make debian-packages   install OpenGL and a virtual screen on Debian or Ubuntu (uses sudo)"

demo: $(VENV)/viewing
	@$(call SAY_MISSING,$(OPENGL_PACKAGES))
	@if $(BIN)/python -c '$(WINDOW_OPENS)' >/dev/null 2>&1; then \
		$(BIN)/deformrf view; \
	else \
		echo "No window can be opened here, so the demo drags a vertex by itself and records it."; \
		mkdir -p out; \
		$(BIN)/deformrf view --headless --frames $(DEMO_FRAMES) --drag $(DEMO_DRAG) \
			--record out/demo.mp4 --screenshot out/demo.png \
		&& echo "The demo is in out/demo.mp4; out/demo.png is its last frame before the vertex is let go."; \
	fi

test: venv
	@$(call SAY_MISSING,$(OPENGL_PACKAGES) $(SCREEN_PACKAGES))
ifeq ($(PYTEST_ARGS),)
	@# Most tests keep one thread busy and others wait (for a window, a process, a disk), so three
	@# run side by side on two cores.  A file's tests share what they made; conftest.py orders files.
	@# A worker that crashes ends the run and names its test: replaced, it waits for ever.  A test
	@# that takes half an hour shows where it is, and ends its worker.
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder \
		--max-worker-restart 0 -o faulthandler_timeout=1800 -o faulthandler_exit_on_timeout=true
else
	$(BIN)/python -m pytest $(PYTEST_ARGS)
endif

soak: venv
	@seed=$$($(BIN)/python -c 'import secrets; print(secrets.randbits(32))'); \
	again="DEFORMRF_TEST_SEED=$$seed make test PYTEST_ARGS='$(PYTEST_ARGS)'"; \
	echo "Random inputs of seed $$seed; to repeat this run: $$again"; \
	PYTHONS='$(PYTHONS)' DEFORMRF_TEST_SEED=$$seed \
		$(MAKE) --no-print-directory test PYTEST_ARGS='$(PYTEST_ARGS)' \
	|| { echo "To repeat this run: $$again"; exit 1; }; \
	$(BIN)/python tests/benchmarks/fuzz_inputs.py --put-back && \
	$(BIN)/python tests/benchmarks/fuzz_inputs.py --seconds 600 --seed $$seed && \
	$(BIN)/python tests/benchmarks/kills.py --count 10 --seed $$seed && \
	$(BIN)/python tests/benchmarks/shortages.py && \
	$(BIN)/python tests/support/readme_lines.py --train

random-use: venv
	$(BIN)/python tests/benchmarks/random_use.py

lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

kernels: venv
	$(BIN)/python tests/benchmarks/ship_kernels.py

venv: $(VENV)/installed

$(VENV)/installed: pyproject.toml constraints.txt $(OTHER_PYTHON)
	@$(MAKE_VENV)
	$(PIP) setuptools
	$(PIP) --no-build-isolation -e '.[all,dev]'
	@touch $(VENV)/viewing $@

# Viewing needs no extra.
# Compiling every module would take as long as installing them; Python compiles what it imports.
$(VENV)/viewing: pyproject.toml constraints.txt $(OTHER_PYTHON)
	@$(MAKE_VENV)
	$(PIP) --no-compile setuptools
	$(PIP) --no-compile --no-build-isolation -e .
	@touch $@

# uv makes environments without pip unless it is told to.
MAKE_VENV = "$(or $(PYTHON),false)" -c '$(PYTHON_FITS)' 2>/dev/null || { \
		echo "deformrf needs Python 3.11 to 3.14 with its venv module (on Debian: python3-venv);" \
			"\"$(or $(PYTHON),python3)\" is not one: name yours with make PYTHON=..., or let uv" \
			"(https://docs.astral.sh/uv) fetch one:" \
			"uv venv --clear --seed --python 3.13 $(VENV) && make $(MAKECMDGOALS)" >&2; exit 1; }; \
	test -z "$(OTHER_PYTHON)" -a -x $(BIN)/pip || "$(PYTHON)" -m venv --clear $(VENV)

# Sets the shell's $missing to those of the given Debian packages that are not installed.
FIND_MISSING = missing=$$(command -v dpkg-query >/dev/null || exit 0; for p in $(1); do \
		dpkg-query -W -f '$${Status}' $$p 2>/dev/null | grep -q 'ok installed' || echo $$p; \
	done | xargs)
SAY_MISSING = $(FIND_MISSING); test -z "$$missing" || \
	echo "Not installed, and you may need them: $$missing (make debian-packages installs them)"

debian-packages:
	@$(call FIND_MISSING,$(OPENGL_PACKAGES) $(SCREEN_PACKAGES)); \
	test -n "$$missing" || exit 0; \
	test "$$(id -u)" = 0 && sudo= || sudo=sudo; \
	echo "Installing Debian packages: $$missing"; \
	$$sudo apt-get update -qq; \
	$$sudo env DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends \
		$$missing >/dev/null || { echo "Could not install all of: $$missing" >&2; exit 1; }
