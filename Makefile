# Every target prepares what it needs. PYTHON is any Python 3.11 or later with venv.
PYTHON ?= python3.11
SERVICES := $(notdir $(wildcard services/*))
SCENARIO ?= back
HOURS ?= 2
WORKSPACE := common people tools $(SERVICES:%=services/%) experiments bench gym

# Every process would compile all modules anew, where an image says that they are not kept.
unexport PYTHONDONTWRITEBYTECODE

# uv where it is present, else pip: the same versions from constraints.txt. What builds our projects
# is installed once and not, as pip would have it, for each of them anew; compiled is what is used.
define make_venv
	rm -rf $(1)
	if command -v uv >/dev/null; then \
		uv venv -q -p $(PYTHON) $(1) && \
		uv pip install -q -p $(1)/bin/python -b constraints.txt -c constraints.txt $(2); \
	else \
		$(PYTHON) -m venv --without-pip $(1) && \
		pip="$(CURDIR)/.venv-pip/bin/pip --python $(1)/bin/python install -q --no-compile -c constraints.txt" && \
		$$pip $(BUILD) && $$pip --no-build-isolation $(2); \
	fi
	touch $(1)/ready
endef
BUILD := hatchling editables
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# what draws without a screen or a graphics card: tests that need it skip where it can't be had
DRAWING := libvulkan1 mesa-vulkan-drivers chromium

# the engine of Gazebo Fortress, and what a program needs to use it
GAZEBO := g++ pkg-config libignition-physics-dev
GAZEBO_MODULES := ignition-physics5-sdf ignition-physics5-mesh ignition-plugin1-loader ignition-common4-graphics ignition-math6-eigen3

.PHONY: help install graph gazebo bench-peers drawing picture run notebook test lint format bench clean $(SERVICES:%=test-%) test-common test-people test-tools test-gym test-experiments test-bench test-system test-ros test-chaos test-compose soak

help:
	@echo "make run          the back-view scenario in real time (SCENARIO=side, …)"
	@echo "make test         everything that is tested; make test-physics and its like: one part"
	@echo "make test-compose the containers, by docker compose up; where Docker can't be had it says so"
	@echo "make lint         style, types and import rules"
	@echo "make test-chaos   a hundred kills at random moments: following goes on"
	@echo "make soak         hours of simulated time: memory, ticks, schedule (HOURS=0.5)"
	@echo "make bench        speed and accuracy, in 5 minutes; mecazen bench compare shows what changed"
	@echo "make bench-peers  the same robot in MuJoCo and in Gazebo's physics"
	@echo "make graph    what is made from the graph of nodes: tables, picture, access rules"
	@echo "make picture      docs/viewer.png and docs/senses.png, from runs in the viewer"
	@echo "make notebook     all cells of examples/notebook.ipynb again"
	@echo "make install      only prepare .venv"

install: .venv/ready

.venv-pip/ready: constraints.txt
	@command -v uv >/dev/null || { rm -rf $(@D) && $(PYTHON) -m venv $(@D) && \
		$(@D)/bin/pip install -q -U -c constraints.txt pip; }
	@mkdir -p $(@D) && touch $@

.venv/ready: pyproject.toml constraints.txt $(WORKSPACE:%=%/pyproject.toml) | .venv-pip/ready
	@echo "preparing .venv: a minute or two the first time"
	@$(call make_venv,.venv,pip $(WORKSPACE:%=-e ./%) --group test --group system --group lint --group bench)

# one service and nothing else: what it does not declare, it does not find
.venv-target/ready .venv-crowd/ready: PEOPLE := -e ./people
.venv-%/ready: constraints.txt common/pyproject.toml people/pyproject.toml tools/pyproject.toml services/%/pyproject.toml | .venv-pip/ready
	@echo "preparing .venv-$*"
	@$(call make_venv,.venv-$*,-e ./common $(PEOPLE) -e ./tools -e ./services/$* --group test)

.venv-common/ready: constraints.txt common/pyproject.toml | .venv-pip/ready
	@echo "preparing .venv-common"
	@$(call make_venv,.venv-common,-e ./common --group test)

.venv-people/ready: constraints.txt common/pyproject.toml people/pyproject.toml | .venv-pip/ready
	@echo "preparing .venv-people"
	@$(call make_venv,.venv-people,-e ./common -e ./people --group test)

.venv-tools/ready: constraints.txt common/pyproject.toml tools/pyproject.toml | .venv-pip/ready
	@echo "preparing .venv-tools"
	@$(call make_venv,.venv-tools,-e ./common -e ./tools[keys] --group test)

GYM := people tools services/physics services/controller services/target services/follower gym
.venv-gym/ready: constraints.txt common/pyproject.toml $(GYM:%=%/pyproject.toml) | .venv-pip/ready
	@echo "preparing .venv-gym"
	@$(call make_venv,.venv-gym,-e ./common $(GYM:%=-e ./%) --group test)

# what speaks with us as ROS does: it holds nothing of ours
.venv-ros/ready: constraints.txt pyproject.toml
	@echo "preparing .venv-ros"
	@$(call make_venv,.venv-ros,--group ros)

run: .venv/ready
	@.venv/bin/mecazen up $(SCENARIO)

drawing:
	@dpkg -s $(DRAWING) >/dev/null 2>&1 || { apt-get update -qq && DEBIAN_FRONTEND=noninteractive \
		apt-get install -y -qq --no-install-recommends $(DRAWING) >/dev/null; } || \
		echo "without $(DRAWING) the tests of pictures are skipped"

graph: .venv/ready
	@.venv/bin/python -m mecazen_tools.generated

picture: .venv/ready drawing
	@.venv/bin/python docs/make_picture.py

notebook: .venv/ready
	@.venv/bin/python docs/make_notebook.py

test: test-common test-people test-tools $(SERVICES:%=test-%) test-gym test-experiments test-bench test-system test-ros

test-common test-people test-tools test-gym $(SERVICES:%=test-%): test-%: .venv-%/ready
	.venv-$*/bin/python -m pytest tests/$*

test-viewer test-system: drawing

test-ros: .venv-ros/ready

test-experiments test-bench test-system test-ros: test-%: .venv/ready
	.venv/bin/python -m pytest tests/$*

test-chaos: .venv/ready
	.venv/bin/python -m pytest -s tests/chaos

soak: .venv/ready
	@.venv/bin/mecazen bench soak --hours $(HOURS)

test-compose: .venv/ready
	@.ci/docker-host || exit 0; exec .venv/bin/python -m pytest tests/compose

lint: .venv/ready
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy
	.venv/bin/lint-imports

format: .venv/ready
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

bench: .venv/ready
	@.venv/bin/mecazen bench run $(BENCH)

bench-peers: .venv/ready gazebo
	@.venv/bin/mecazen bench run --only peers $(BENCH)

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
	rm -rf .venv .venv-*
