# make demo, make test: what they need from PyPI goes into .venv, nothing else is touched.
# make system: what they need from Debian or Ubuntu, as root.
# make meshlab-plugin: the same, and MeshLab's sources by apt, for the plugin's tests alone.
# make browser: Chromium, without which the tests of the comparison's report are skipped; as root.
# make ext: the native module beside its sources, for work on the package without installing it.
# make docs: the documentation site, in docs/_build/html.
# make sanitize: kernels and pipeline under GCC's sanitizers; minutes, and not part of make test.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# What the wheel is built from: a change here, and only here, means installing again.
SOURCES := pyproject.toml CMakeLists.txt README.md LICENSE \
	$(shell find o3d_sofnn filters/meshlab_sofnn -type f \
		\( -name '*.py' -o -name '*.pyi' -o -name '*.typed' -o -name '*.[ch]pp' \
		-o -path '*/page/*' \) 2>/dev/null)

# MeshLab's sources, of which the headers are read, come by apt from the configured Debian mirror, and from
# a suite that has 2022.02. PyMeshLab of the same release supports Python up to 3.11.
PYTHON311 ?= python3.11
MESHLAB := $(VENV)/build/meshlab
MESHLAB_SUITE := trixie main
MESHLAB_MIRROR = $(shell apt-get indextargets --format '$$(LABEL) $$(REPO_URI)' 'Created-By: Packages' \
	| sed -n '/^Debian /{s///p;q}')
MESHLAB_SHA256 := 11da26ec46c3fbbbc806d410a3221542ec21ec13fdcc55d624304600029435fd

.PHONY: help system browser demo test lint docs meshlab-plugin ext sanitize clean

help:
	@echo "make system  install the system packages (Debian, Ubuntu; as root)"
	@echo "make browser install Chromium, for the tests of the comparison's report (as root)"
	@echo "make demo    reconstruct scans, write meshes and pictures, compare with other methods"
	@echo "make test    lint, types, tests of the installed wheel"
	@echo "make docs    build the documentation site in docs/_build/html"
	@echo "make meshlab-plugin"
	@echo "             download MeshLab's headers, build the native plugin and test it (filters/README.md)"
	@echo "make ext     build the native module in place"
	@echo "make sanitize"
	@echo "             run kernels and pipeline under the compiler's sanitizers"
	@echo "make clean   remove the environment, builds and caches"

system:
	apt-get update -qq
	DEBIAN_FRONTEND=noninteractive apt-get install -qq -y g++ python3-venv libusb-1.0-0 libgl1 libegl1 libopengl0 libgomp1

browser:
	DEBIAN_FRONTEND=noninteractive apt-get install -qq -y chromium

demo: $(VENV)/.demo
	$(BIN)/python demos/quickstart.py --quick
	$(BIN)/python demos/compare.py --quick

# Tests take the installed package: pytest does not put the source tree on the path. A process per
# core, four at most since each takes up to 2 GB; the tests of a file stay together.
test: lint
	env -u PYTHONPATH $(BIN)/pytest --numprocesses auto --maxprocesses 4 --dist loadfile

lint: $(VENV)/.test
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	env -u PYTHONPATH $(BIN)/mypy

# A warning is an error, also for a link or a name that leads nowhere (-n).
docs: $(VENV)/.docs
	env -u PYTHONPATH $(BIN)/sphinx-build --fail-on-warning --nitpicky --keep-going --quiet \
		-d docs/_build/doctrees docs docs/_build/html
	@echo "open docs/_build/html/index.html"

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip

$(VENV)/.demo: $(SOURCES) | $(BIN)/python
	$(BIN)/python -m pip install --quiet '.[open3d,demos]'
	touch $@

$(VENV)/.test: $(SOURCES) | $(BIN)/python
	$(BIN)/python -m pip install --quiet '.[test]'
	touch $@

$(VENV)/.docs: $(SOURCES) | $(BIN)/python
	$(BIN)/python -m pip install --quiet '.[docs]'
	touch $@

meshlab-plugin: $(VENV)/.test $(MESHLAB)/.source $(MESHLAB)/.python
	env -u PYTHONPATH MESHLAB_SRC=$(CURDIR)/$(MESHLAB)/source/src MESHLAB_BUILD=$(CURDIR)/$(MESHLAB)/plugin \
		MESHLAB_PYTHON=$(CURDIR)/$(MESHLAB)/python/bin/python \
		$(BIN)/pytest tests/filters/test_meshlab_plugin.py tests/filters/test_meshlab_program.py

# Lists, cache and sources of its own: no root is needed, and nothing of the system's apt changes.
APT := apt-get -qq -o Dir::State::Lists=$(CURDIR)/$(MESHLAB)/apt/lists -o Dir::Cache=$(CURDIR)/$(MESHLAB)/apt \
	-o Dir::Etc::SourceList=$(CURDIR)/$(MESHLAB)/apt/sources.list -o Dir::Etc::SourceParts=- \
	-o APT::Sandbox::User=root

$(MESHLAB)/.source: | $(BIN)/python
	mkdir -p $(MESHLAB)/source $(MESHLAB)/apt/lists/partial $(MESHLAB)/apt/archives/partial
	test -n "$(MESHLAB_MIRROR)" || { echo "apt has no lists of Debian (on Ubuntu, where no release has" \
		"these sources, install debian-archive-keyring and add MESHLAB_MIRROR=address)" >&2; exit 1; }
	echo "deb-src [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg]" \
		"$(MESHLAB_MIRROR) $(MESHLAB_SUITE)" > $(MESHLAB)/apt/sources.list
	$(APT) update
	rm -f $(MESHLAB)/meshlab_*.orig.tar.*
	cd $(MESHLAB) && $(APT) source --tar-only meshlab
	mv $(MESHLAB)/meshlab_*.orig.tar.* $(MESHLAB)/source.tar.xz
	echo "$(MESHLAB_SHA256)  $(MESHLAB)/source.tar.xz" | sha256sum --check --quiet
	tar -xf $(MESHLAB)/source.tar.xz -C $(MESHLAB)/source --strip-components=1
	touch $@

$(MESHLAB)/.python:
	mkdir -p $(MESHLAB)
	$(PYTHON311) -m venv $(MESHLAB)/python
	$(MESHLAB)/python/bin/python -m pip install --quiet \
		pymeshlab==2022.2.post4 "numpy<2" scipy
	touch $@

ext:
	rm -rf build/ext
	$(PYTHON) -m pip wheel --quiet --no-deps --wheel-dir build/ext .
	cd build/ext && $(PYTHON) -m zipfile -e *.whl unpacked
	cp build/ext/unpacked/o3d_sofnn/_kernels*.so o3d_sofnn/

sanitize: $(VENV)/.test
	env -u PYTHONPATH $(BIN)/python demos/benchmarks/fuzz/sanitize.py

clean:
	rm -rf $(VENV) build dist docs/_build .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
