# Everything runs in a virtual environment that sees the distribution's packages.
PYTHON := .venv/bin/python
PACKAGES := python3-dolfinx python3-petsc4py python3-mpi4py python3-gmsh python3-scipy \
            python3-matplotlib python3-pytest python3-pytest-xdist python3-hypothesis \
            python3-ezdxf python3-shapely python3-mypy python3-venv python3-pip python3-dev gcc openmpi-bin \
            libopenblas0-serial
# For the report as PDF, and to test its slider in a browser; without them these tests are skipped.
BROWSER := weasyprint chromium chromium-driver python3-selenium
# Of the site: MathJax, and what of it draws formulas as SVG.
MATHJAX := /usr/share/javascript/mathjax
DRAWS := MathJax.js config/TeX-AMS_SVG.js extensions jax/element jax/input/TeX \
         jax/output/SVG/jax.js jax/output/SVG/config.js jax/output/SVG/autoload jax/output/SVG/fonts/TeX
INSTALL := $(if $(filter 0,$(shell id -u)),,sudo )
RUFF := ruff==0.15.0
# The second solver of the tests, with numpy, scipy and cffi of the distribution; no Debian package.
CLARABEL := clarabel==0.11.1
MKDOCS := mkdocs==1.6.1 mkdocstrings-python==2.0.11
# What the site is made of. With --quiet, mkdocs counts no warnings and --strict lets them pass.
PAGES := README.md CHANGELOG.md CONTRIBUTING.md CITATION.cff LICENSE docs demos meshes benchmarks

# Debian 13 in a folder: where, what it leaves out, its mirror (empty: that of this machine), and
# which tests run in it (all: make test-debian13 TESTS13=).
TREE13 := .debian13
PACKAGES13 := $(filter-out python3-mypy python3-venv python3-pip,$(PACKAGES))
MIRROR13 :=
LIBRARY13 := $(TREE13)/usr/local/lib/python3.13/dist-packages
TESTS13 := -m "not slow"
IN_TREE13 := TREE="$(TREE13)" PACKAGES="$(PACKAGES13)" MIRROR="$(MIRROR13)" .ci/debian13

# Processes that share the tests, and numbers of ranks that those in parallel run on.
WORKERS := 2
RANKS := 2 3
MPI := mpi

export OMP_NUM_THREADS := 1
# Where the environment forbids to keep compiled modules, each of the programs that the tests start
# would compile the package: 1.5 s.
unexport PYTHONDONTWRITEBYTECODE
# mpirun asks for these where root runs it, as in a container.
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
# Ranks that wait leave the core to others.
export OMPI_MCA_mpi_yield_when_idle := 1

.PHONY: help setup packages debootstrap browser mathjax debian13 demo gallery docs test test-browser test-debian13 run-debian13 test-slow test-mpi lint meshes benchmarks clean
help:  ## say what there is
	@grep -E '^[a-z0-9-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/'

setup: packages .venv/installed  ## install what is missing: Debian packages, virtual environment

packages: NEEDED := $(PACKAGES)
debootstrap: NEEDED := debootstrap
browser: NEEDED := $(BROWSER)
mathjax: NEEDED := libjs-mathjax
packages debootstrap browser mathjax:
	@missing=""; for p in $(NEEDED); do \
	  dpkg-query -W -f='$${Status}' $$p 2>/dev/null | grep -q "ok installed" || missing="$$missing $$p"; \
	done; \
	if [ -n "$$missing" ]; then echo "installing:$$missing"; \
	  $(INSTALL)apt-get update -qq && \
	  DEBIAN_FRONTEND=noninteractive $(INSTALL)apt-get install -y -qq --no-install-recommends $$missing; fi

.venv/installed: pyproject.toml
	/usr/bin/python3 -m venv --system-site-packages .venv
	$(PYTHON) -m pip install --quiet --no-deps --no-build-isolation --editable .
	$(PYTHON) -m pip install --quiet --no-deps $(CLARABEL)
	touch $@

.venv/bin/ruff: | .venv/installed
	$(PYTHON) -m pip install --quiet $(RUFF)

.venv/bin/mkdocs: | .venv/bin/ruff  # pip installs one after the other
	$(PYTHON) -m pip install --quiet $(MKDOCS)

demo: setup  ## the limit load of a wall with an opening, with files and pictures
	$(PYTHON) demos/03_wall_w3.py
	@echo "in demos/output/w3: report.html, scene.png, collapse.png, forces.png, thrust.png, stress.png, capacity.png"
	@echo "all demos with their pictures: docs/gallery.md; to run them: make gallery"

gallery: setup  ## run all demos; small copies of their pictures for docs/gallery.md (2 minutes)
	for demo in demos/[0-9]*.py; do $(PYTHON) $$demo || exit 1; done
	$(PYTHON) docs/gallery_pictures.py

docs: setup mathjax .venv/bin/mkdocs  ## the site of documentation, in build/site; fails at links that lead nowhere
	rm -rf build/pages && mkdir -p build/pages
	ln -s $(addprefix $(CURDIR)/,$(PAGES)) build/pages/
	.venv/bin/mkdocs build --strict
	mkdir build/site/mathjax && cd $(MATHJAX) && cp -RL --parents $(DRAWS) $(CURDIR)/build/site/mathjax/
	@echo "open build/site/index.html; its search needs a server: python3 -m http.server -d build/site"

test: setup  ## run the tests that take less than a few seconds each
	$(PYTHON) -m pytest -n $(WORKERS) -m "not slow"

test-browser: setup browser  ## the report as PDF and in a browser (installs WeasyPrint and Chromium)
	$(PYTHON) -m pytest -n $(WORKERS) tests/system/test_browser.py tests/system/test_report_pdf.py

test-slow: setup  ## run all other tests
	$(PYTHON) -m pytest -n $(WORKERS) -m slow

test-mpi: setup  ## run the tests in parallel, on 2 and 3 ranks (others: make test-mpi RANKS=4)
	for n in $(RANKS); do \
	  mpirun --oversubscribe --timeout 900 -n $$n $(PYTHON) -m pytest -m "$(MPI)" -p no:xdist -p no:cacheprovider \
	  || exit 1; done

debian13: debootstrap .venv/installed  # a Debian 13 tree with the packages, as root
	$(IN_TREE13) make
	$(PYTHON) -m pip install --quiet --no-deps --upgrade --target $(LIBRARY13) $(CLARABEL)

test-debian13: debian13  ## run the quick tests on Debian 13, in a folder, as root
	$(IN_TREE13) test -n $(WORKERS) $(TESTS13)

run-debian13: debian13  ## run a command there: make run-debian13 RUN13="python3 demos/14_dolfinx_mesh.py"
	$(IN_TREE13) run $(RUN13)

lint: setup .venv/bin/ruff  ## ruff and mypy
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	$(PYTHON) -m mypy

meshes: setup  ## make the meshes of meshes/ again
	$(PYTHON) meshes/make_meshes.py

benchmarks: setup  ## measure run times, errors and costs: tables and pictures of docs/cost.md (12 minutes)
	$(PYTHON) benchmarks/run.py --quick --write

clean:  ## remove what was made
	rm -rf .venv .debian13 build *.egg-info demos/output .pytest_cache .mypy_cache .ruff_cache
