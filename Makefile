# Each target does all the set-up that it needs, once; the second time there is nothing to do.

VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= $(shell for p in python3 python3.12 python3.11; do \
	$$p -c "$(PYTHON_FITS)" 2>/dev/null && echo $$p && break; done)
PYTHON_FITS := import sys, ensurepip; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))

# OpenGL for the viewer; a virtual screen and a robot hand for the tests of its window.
DEBIAN_PACKAGES := libgl1 libglx-mesa0 libgl1-mesa-dri libegl1 libegl-mesa0 libx11-6 \
	xvfb xauth xdotool

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

.PHONY: help demo test lint venv debian-packages

help:
	@echo "make demo   open the bundled model (set-up included)"
	@echo "make test   run the tests (set-up included; PYTEST_ARGS='-k camera' for some of them)"
	@echo "make lint   check style and formatting"
	@echo "make venv   set-up alone: $(VENV) with the versions of constraints.txt"

demo: debian-packages venv
	@if $(BIN)/python -c '$(WINDOW_OPENS)' >/dev/null 2>&1; then \
		$(BIN)/deformrf-view; \
	else \
		echo "No window can be opened here, so the demo drags a vertex by itself and records it."; \
		mkdir -p out; \
		$(BIN)/deformrf-view --headless --frames $(DEMO_FRAMES) --drag $(DEMO_DRAG) \
			--record out/demo.mp4 --screenshot out/demo.png \
		&& echo "The demo is in out/demo.mp4; out/demo.png is its last frame before the vertex is let go."; \
	fi

test: debian-packages venv
	$(BIN)/python -m pytest $(PYTEST_ARGS)

lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

venv: $(VENV)/installed

$(VENV)/installed: pyproject.toml constraints.txt
	@"$(or $(PYTHON),false)" -c '$(PYTHON_FITS)' 2>/dev/null || { \
		echo "deformrf needs Python 3.11 or 3.12 with its venv module (on Debian: python3-venv);" \
			"\"$(or $(PYTHON),python3)\" is not one: name yours with make PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -c constraints.txt setuptools
	$(BIN)/python -m pip install -c constraints.txt --no-build-isolation -e '.[dev]'
	@touch $@

# Missing packages are not an error here: whatever needs them says so itself.
debian-packages:
	@command -v dpkg-query >/dev/null || exit 0; \
	missing=$$(for p in $(DEBIAN_PACKAGES); do \
		dpkg-query -W -f '$${Status}' $$p 2>/dev/null | grep -q 'ok installed' || echo $$p; \
	done | xargs); \
	[ -n "$$missing" ] || exit 0; \
	if [ "$$(id -u)" = 0 ]; then sudo=; \
	elif sudo -n true 2>/dev/null; then sudo=sudo; \
	else echo "Not installed, and you may need them: apt install $$missing"; exit 0; fi; \
	echo "Installing Debian packages: $$missing"; \
	$$sudo apt-get update -qq; \
	$$sudo env DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends \
		$$missing >/dev/null || echo "Could not install all of: $$missing"
