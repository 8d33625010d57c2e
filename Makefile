# Two commands on a fresh machine: `make demo` (core only, no torch, no GPU, from a wheel) and `make test` (everything).
PYTHON ?= python3
.DEFAULT_GOAL := help
CORE := .venv
DEV := .venv-dev
# NiceGUI is global: tests of its server have a process of their own.
DASHBOARD := tests/adapters/test_dashboard.py
export PYTHONUTF8 := 1
export ORT_DISABLE_TELEMETRY := 1

.PHONY: help demo wheel test lint docs smoke audit arm64 clean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z0-9]+:.*## / {printf "make %-8s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: $(CORE)/.wheel ## install the core from a wheel, and fly the shipped sample approach
	$(CORE)/bin/deckline demo --out demo-out

wheel: $(CORE)/.wheel ## source archive and wheel into dist/

test: $(DEV)/.dev system ## install all extras, and run the tests
	OMP_NUM_THREADS=1 $(DEV)/bin/python -m pytest --numprocesses auto --dist loadfile --max-worker-restart 0 --ignore $(DASHBOARD)
	OMP_NUM_THREADS=1 $(DEV)/bin/python -m pytest $(DASHBOARD)

lint: $(DEV)/.dev ## ruff, mypy, import contracts
	$(DEV)/bin/ruff check .
	$(DEV)/bin/ruff format --check src tests benchmarks examples scripts ros2
	$(DEV)/bin/mypy
	$(DEV)/bin/lint-imports

docs: $(DEV)/.docs ## build the site: open site/index.html
	NO_MKDOCS_2_WARNING=1 $(DEV)/bin/mkdocs build --strict
	@! grep -rlE --include='*.html' -e '--8 ?(<|&lt;)' site || { echo 'a snippet marker is not rendered on these pages' >&2; exit 1; }
	@echo "open site/index.html"

# The core's demo and a smoke test on every other interpreter that is there; their packages are the newest, not the locked ones.
smoke: $(CORE)/.wheel ## the demo on every Python 3.12 and later that is found
	@sh scripts/smoke-interpreters

# Known vulnerabilities of the locked packages; needs the network.
audit: ## known vulnerabilities of the locked packages
	$(PYTHON) -m venv .venv-audit
	.venv-audit/bin/pip install --quiet pip-audit
	.venv-audit/bin/pip-audit --disable-pip --require-hashes --requirement requirements.lock
	.venv-audit/bin/pip-audit --disable-pip --require-hashes --requirement requirements-dev.lock
	.venv-audit/bin/pip-audit --disable-pip --require-hashes --requirement requirements-flight.lock

arm64: ## wheels on PyPI for arm64 of every package that flies; needs the network, 250 MB
	@PYTHON=$(PYTHON) sh scripts/check-arm64

# Both environments take the same versions, by hash; torch comes from PyPI or an index of your own.
$(CORE)/.core: pyproject.toml requirements.lock
	$(PYTHON) -m venv $(CORE)
	$(CORE)/bin/pip install --quiet --no-deps --require-hashes --requirement requirements.lock
	touch $@

# The wheel is made from the source archive, so that both are tried; it is installed, not the working tree.
$(CORE)/.wheel: $(CORE)/.core PYPI.md $(shell find src -type f -not -path "*/__pycache__/*" -not -path "*.egg-info/*")
	rm -rf dist
	$(CORE)/bin/python -c "from setuptools.build_meta import build_sdist; build_sdist('dist')" > /dev/null
	$(CORE)/bin/pip wheel --quiet --no-deps --no-build-isolation --wheel-dir dist dist/deckline-*.tar.gz
	$(CORE)/bin/pip install --quiet --no-deps --force-reinstall dist/deckline-*.whl
	touch $@

$(DEV)/.dev: pyproject.toml requirements-dev.lock
	$(PYTHON) -m venv $(DEV)
	$(DEV)/bin/pip install --quiet torch==2.13.0
	$(DEV)/bin/pip install --quiet --no-deps --require-hashes --requirement requirements-dev.lock
	$(DEV)/bin/pip install --quiet --no-deps --no-build-isolation --editable ".[sim,train,viz,logs,flight,dev]"
	touch $@

$(DEV)/.docs: $(DEV)/.dev
	$(DEV)/bin/pip install --quiet --editable ".[docs]"
	touch $@

# EGL (the simulator) and Chromium (the report's tests) come from the system.
.PHONY: system
system:
	@sh scripts/system-packages

clean: ## remove what the targets made
	rm -rf $(CORE) $(DEV) .venv-audit .venv-smoke-* demo-out build dist site
