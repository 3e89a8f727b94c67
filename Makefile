# Every target prepares what it needs, with the first of PYTHONS that runs and is 3.11 to 3.13, or
# with PYTHON. Without uv it needs ensurepip, which Debian has in a package of its own.
PYTHONS := python3.13 python3.12 python3.11 python3
USABLE = import sys$(if $(UV),,, ensurepip); sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))
USED = $(or $(shell for one in $(or $(PYTHON),$(PYTHONS)); do $(RUNS) && echo $$one && break; done),$(error \
	Python 3.11, 3.12 or 3.13 with venv is needed, but not found as $(or $(PYTHON),$(PYTHONS)). Install it \
	(Debian, Ubuntu: apt install python3-venv) or name it: make PYTHON=/path/to/python))
RUNS = $$one -c '$(USABLE)' 2>/dev/null
SERVICES := $(notdir $(wildcard services/*))
# tests of these parts run with the base and their extras alone: what is not declared is not found
EXTRA_base := ros2,maps,target
EXTRA_hardware := hardware,physics,target,follower
EXTRA_physics := physics,target
EXTRA_recorder := recorder,target,plot
EXTRA_tools := ros2,target,keys,plot
EXTRA_develop := all,studies,cluster,train,bench,notebook
EXTRA_simulate := physics,target,follower,sensors
EXTRA_lowest := physics,target,follower,ros2,maps,keys,plot
BASE := common people controller target guard
PARTS := $(filter-out $(BASE),$(SERVICES)) tools gym
SCENARIO ?= back
SCALE ?= 120
LOWEST ?= common people tools follower controller target physics
HUNDREDS ?= 1
# what fails in a pipe fails the step
SHELL := bash
.SHELLFLAGS := -o pipefail -c

# Every process would compile all modules anew, where an image says that they are not kept.
unexport PYTHONDONTWRITEBYTECODE

# uv where it is present, else pip: the same versions from constraints.txt
UV := $(shell command -v uv)
ifneq ($(UV),)
NEW = uv venv -q -p $(1)
INSTALL = uv pip install -p $(1)/bin/python -b constraints.txt -c constraints.txt
BUILD_DIST := uv build -q -b constraints.txt -o dist
else
PIP := .venv-pip/bin/pip
NEW = $(1) -m venv --without-pip
INSTALL = $(PIP) --python $(1)/bin/python install --no-compile --no-build-isolation -c constraints.txt
BUILD_DIST := .venv/bin/python -m hatchling build -t sdist -d dist >/dev/null && \
	$(PIP) --python .venv/bin/python wheel -q --no-deps --no-build-isolation -w dist dist/*.tar.gz
endif
BUILD := hatchling editables
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# make_venv FOLDER, STEP: an empty environment
make_venv = python=$(USED) && echo "[$(2)] $(1): an empty environment of $$($$python -V)" && rm -rf $(1) && \
	$(call NEW,$$python) $(1) && $(call INSTALL,$(1)) -q $(BUILD)

# install FOLDER, STEP, WORDS, WHAT: say so, name the large files as they come, and the time that it took
install = start=$$(date +%s) && echo "[$(2)] $(1): $(3)" && $(call INSTALL,$(1)) $(4) | sed -un '$(FETCHED)' && \
	echo "[$(2)] $(1): $$(($$(date +%s) - start)) s"
# of pip's lines "Downloading numpy-2.4.6-cp311-cp311-….whl (16.7 MB)"; uv and errors speak for themselves
FETCHED := s|^ *Downloading \(.*/\)\?\([A-Za-z0-9_.]*-[0-9.]*\)-.* \(([0-9.]* MB)\).*|    \2 \3|p

# what draws without a screen or a graphics card: tests that need it skip where it can't be had
DRAWING := libvulkan1 mesa-vulkan-drivers chromium

# the engine of Gazebo Fortress, and what a program needs to use it
GAZEBO := g++ pkg-config libignition-physics-dev
GAZEBO_MODULES := ignition-physics5-sdf ignition-physics5-mesh ignition-plugin1-loader ignition-common4-graphics ignition-math6-eigen3

.PHONY: docs results results-check help install develop graph gazebo bench-peers drawing pictures run notebook test lint format bench clean $(SERVICES:%=test-%) test-common test-people test-tools test-gym test-experiments test-bench test-system test-documents test-ros test-pythons test-lowest test-chaos test-compose test-dist dist soak

help:
	@echo "make run          the back-view scenario in real time (SCENARIO=side, …)"
	@echo "make test         all tests but chaos, containers, Pythons and soak; make test-physics and its like: one part"
	@echo "make test-pythons the same results with each Python that is installed"
	@echo "make test-lowest  most parts with the lowest version of each dependency that is allowed"
	@echo "make test-compose the containers, by docker compose up; where Docker can't be had it says so"
	@echo "make lint         style, types and import rules"
	@echo "make test-chaos   a hundred kills and freezes at random moments (HUNDREDS=10 LOG=FILE: a thousand)"
	@echo "make soak         hours of simulated time, of floods and of hostile payloads (SCALE=30)"
	@echo "make bench        speed and accuracy, in some minutes; mecazen bench compare shows what changed"
	@echo "make results      the experiments and benchmarks whose inputs have changed, their tables and figures (ONLY=table2)"
	@echo "make bench-peers  the same robot in MuJoCo and in Gazebo's physics"
	@echo "make graph        what is made from the code: references, tables, access rules"
	@echo "make pictures     the pictures of the documents, from runs (ONLY=viewer)"
	@echo "make notebook     all cells of examples/notebook.ipynb again"
	@echo "make docs         the documentation as a site, in site/; each link must lead somewhere"
	@echo "make dist         a source distribution and its wheel, to be installed elsewhere: docs/deploy.md"
	@echo "make install      only prepare .venv for make run; make develop: for everything else too"

install: .venv/ready

develop: .venv/developer

.venv-pip/ready: constraints.txt
	@$(if $(PIP),rm -rf $(@D) && $(USED) -m venv $(@D) && $(PIP) install -q -U -c constraints.txt pip)
	@mkdir -p $(@D) && touch $@

# editable, so that a change of ours needs no other install
.venv/ready: constraints.txt pyproject.toml | .venv-pip/ready
	@$(call make_venv,.venv,1/2)
	@$(call install,.venv,2/2,mecazen with all services,pip -e '.[all]')
	@touch $@

.venv/developer: .venv/ready
	@$(call install,.venv,1/1,and what studies and tests and linters need,\
		-e '.[$(EXTRA_develop)]' --group test --group system --group lint)
	@touch $@

.venv-base/ready: constraints.txt pyproject.toml | .venv-pip/ready
	@$(call make_venv,.venv-base,1/2)
	@$(call install,.venv-base,2/2,the base,-e '.[$(EXTRA_base)]' --group test)
	@touch $@

$(PARTS:%=.venv-%/ready): .venv-%/ready: constraints.txt pyproject.toml | .venv-pip/ready
	@$(call make_venv,.venv-$*,1/2)
	@$(call install,.venv-$*,2/2,$* alone,-e '.[$(or $(EXTRA_$*),$*)]' --group test)
	@touch $@

.venv-docs/ready: constraints.txt pyproject.toml | .venv-pip/ready
	@$(call make_venv,.venv-docs,1/2)
	@$(call install,.venv-docs,2/2,what makes the site of the documentation,--group docs)
	@touch $@

# another Python, to compare its results
.venv-python%/ready: constraints.txt pyproject.toml | .venv-pip/ready
	@$(call make_venv,$(@D),1/2)
	@$(call install,$(@D),2/2,what runs a scenario,-e '.[$(EXTRA_simulate)]')
	@touch $@

# the lowest versions that pyproject.toml allows
.venv-lowest/ready: pyproject.toml | .venv-pip/ready
	@$(call make_venv,.venv-lowest,1/2)
	@grep -Eoh '"[a-z0-9-]+(\[[a-z]+\])?>=[0-9.]+"' $< | sed -E 's/"|\[.*\]//g; s/>=/==/' | sort -u >$(@D)/lowest.txt
	@$(subst constraints.txt,$(@D)/lowest.txt,$(call install,$(@D),2/2,the lowest versions,-e '.[$(EXTRA_lowest)]' --group test))
	@touch $@

# what speaks with us as ROS does: it holds nothing of ours
.venv-ros/ready: constraints.txt pyproject.toml | .venv-pip/ready
	@$(call make_venv,.venv-ros,1/2)
	@$(call install,.venv-ros,2/2,what speaks as ROS does,--group ros)
	@touch $@

run: .venv/ready
	@.venv/bin/mecazen up $(SCENARIO)

# MkDocs Material would else print a note about MkDocs' future
docs: .venv-docs/ready
	@NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build

# a source distribution, its wheel, and the versions that they were tested with
dist: .venv/ready
	@rm -rf dist && $(BUILD_DIST) && cp constraints.txt dist && ls dist

drawing:
	@dpkg -s $(DRAWING) >/dev/null 2>&1 || { apt-get update -qq && DEBIAN_FRONTEND=noninteractive \
		apt-get install -y -qq --no-install-recommends $(DRAWING) >/dev/null; } || \
		echo "without $(DRAWING) the tests of pictures are skipped"

graph: .venv/developer
	@.venv/bin/python -m docs.reference

pictures: .venv/developer drawing
	@.venv/bin/python -m docs.pictures $(ONLY)

notebook: .venv/developer
	@.venv/bin/python docs/make_notebook.py

# tests wait for clocks, packages and processes: three jobs keep two cores busy, the longest first
test:
	@$(MAKE) -j3 -Otarget test-system test-documents test-experiments test-common test-people test-tools test-gym \
		$(SERVICES:%=test-%) test-bench test-ros test-dist docs

$(BASE:%=test-%): test-%: .venv-base/ready
	.venv-base/bin/python -m pytest tests/$*

$(PARTS:%=test-%): test-%: .venv-%/ready
	.venv-$*/bin/python -m pytest tests/$*

test-viewer: drawing

test-ros: .venv-ros/ready

test-dist: dist

test-experiments test-bench test-ros test-dist: test-%: .venv/developer
	.venv/bin/python -m pytest tests/$*

# the longest: a prerequisite that runs would let all others begin before it
test-system: .venv/developer
	@$(MAKE) -s drawing
	.venv/bin/python -m pytest tests/system --ignore tests/system/documents

test-documents: .venv/developer
	.venv/bin/python -m pytest tests/system/documents

# warnings of old versions are their own
test-lowest: .venv-lowest/ready
	.venv-lowest/bin/python -m pytest -o filterwarnings= $(addprefix tests/,$(LOWEST))

test-pythons: .venv/developer
	@for one in $(PYTHONS); do ! $(RUNS) || $(MAKE) -s PYTHON=$$one \
		.venv-python$$($$one -c 'import sys; print("%d.%d" % sys.version_info[:2])')/ready || exit 1; done
	.venv/bin/python -m pytest tests/system/test_one_result.py -k python

test-chaos: .venv/developer
	.venv/bin/python -m pytest -s -o faulthandler_timeout=0 --scale $(HUNDREDS) $(if $(LOG),--log $(LOG)) tests/chaos

soak: .venv/developer
	.venv/bin/python -m pytest -s -o faulthandler_timeout=0 --scale $(SCALE) tests/system/test_soak.py

test-compose: .venv/developer
	@.ci/docker-host || exit 0; exec .venv/bin/python -m pytest tests/compose

lint: .venv/developer
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/lint-imports
	.venv/bin/python results/make.py --check

format: .venv/developer
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

bench: .venv/developer
	@.venv/bin/mecazen bench run $(BENCH)

results: .venv/developer $(if $(filter-out bench-physics,$(ONLY)),,gazebo)
	@.venv/bin/python results/make.py $(ONLY) $(CLUSTER:%=--cluster %)

results-check: .venv/developer
	@.venv/bin/python results/make.py --check $(if $(RELEASE),--stale)

bench-peers: .venv/developer gazebo
	@.venv/bin/mecazen bench run --only physics $(BENCH)

gazebo:
	@dpkg -s $(GAZEBO) >/dev/null 2>&1 || { apt-get update -qq && DEBIAN_FRONTEND=noninteractive \
		apt-get install -y -qq --no-install-recommends $(GAZEBO); } >/dev/null 2>&1 || \
		echo "without $(GAZEBO) the rows of Gazebo's physics are left out"
	@! pkg-config --exists $(GAZEBO_MODULES) 2>/dev/null || $(MAKE) -s bench/build/gazebo-peer

bench/build/gazebo-peer: bench/gazebo/gazebo_peer.cpp
	@mkdir -p $(@D)
	@echo "building $@"
	@g++ -O2 -std=c++17 -rdynamic $< -o $@ -DENGINES='"'$$(pkg-config --variable=libdir ignition-physics5)/ign-physics-5/engine-plugins'"' \
		$$(pkg-config --cflags --libs $(GAZEBO_MODULES))

clean:
	rm -rf .venv .venv-* dist site
