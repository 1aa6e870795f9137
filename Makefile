# make demo   sets up everything needed and shows a walking robot that weighs what lands on its back
# make test   sets up everything needed and runs the tests and checks
# make docs   builds the documentation site, out/site/index.html
# All need git, make and Python 3.11 or newer with pip; PYTHON=python3.12 chooses another interpreter.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# What is installed, versions and hashes, is in requirements/*.lock; these files say that it has been.
RUNTIME := $(VENV)/.runtime
DEVELOPMENT := $(VENV)/.development

.PHONY: demo test docs lock vendor clean

demo: $(RUNTIME)
	$(BIN)/stadera demo

test: $(DEVELOPMENT)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --num-workers auto
	PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder # a file in one process: its logs are made once

docs: $(DEVELOPMENT)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

$(RUNTIME): requirements/runtime.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/runtime.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

$(DEVELOPMENT): requirements/development.lock pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/development.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@ $(RUNTIME)

# writes the lock files anew; needs uv (pip install uv)
LOCK := uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-annotate --custom-compile-command "make lock"
lock:
	mkdir -p requirements
	$(LOCK) pyproject.toml requirements/build.in --extra lab --extra live -o requirements/runtime.lock
	$(LOCK) pyproject.toml requirements/build.in --extra models --extra dev --extra bench -c requirements/runtime.lock -o requirements/development.lock

# renews the scripts that pages carry inside; needs npm
VENDOR := src/stadera/report/vendor
THREE := src/stadera/lab/report/vendor
vendor:
	mkdir -p out && cd out && npm pack --silent plotly.js-basic-dist-min && tar xzf plotly.js-basic-dist-min-*.tgz
	cp out/package/plotly-basic.min.js $(VENDOR)/ && cp out/package/LICENSE $(VENDOR)/plotly-basic.LICENSE
	@head -c 60 $(VENDOR)/plotly-basic.min.js; echo " (write the version into $(VENDOR)/README.md)"
	cp $(THREE)/three_parts.js out/ && cd out && npm install --silent --no-save three@0.187.0 esbuild@0.28.2
	out/node_modules/.bin/esbuild out/three_parts.js --bundle --minify --format=iife --global-name=THREE --outfile=$(THREE)/three.min.js
	cp out/node_modules/three/LICENSE $(THREE)/three.LICENSE

clean:
	rm -rf $(VENV) out build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
