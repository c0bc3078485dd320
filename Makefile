# The same few commands everywhere. Nothing but Python 3.11 or newer needs to be installed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CORE := $(VENV)/.core
DEV := $(VENV)/.dev
VLM := $(VENV)/.vlm
MODELS := $(VENV)/.models
BROWSER := $(VENV)/.browser
BENCH := $(VENV)/.bench
MUTANTS := $(VENV)/.mutants
FUZZ := $(VENV)/.fuzz
INSPECT := $(VENV)/inspect
DOCS := $(VENV)/.docs
EXTRAS := $(VENV)/.extras
PROJECTS := pyproject.toml organisms/pyproject.toml

# Python keeps what it compiled, also where the environment says otherwise: else each start of a command compiles it anew.
export PYTHONDONTWRITEBYTECODE :=

# What nobody imports is not compiled; what somebody does, Python compiles and keeps.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt

# One process more than there are processors: many tests wait for a server, a child or a clock.
WORKERS ?= $(shell $(PYTHON) -c 'import os; print(min(8, 1 + (os.cpu_count() or 1)))')

# Where memory has room for them, the folders of tests lie there: a disk would be asked to keep each call of each run.
export PYTEST_DEBUG_TEMPROOT := $(shell $(PYTHON) -c 'import os, shutil; m = "/dev/shm"; print(m if os.access(m, os.W_OK) and shutil.disk_usage(m).free > 4 << 30 else "")')

CHROMIUM := $(shell command -v chromium || command -v chromium-browser || command -v google-chrome)

.PHONY: help demo demo-vlm demo-policy ladder hierarchy extras test test-slow test-models test-lerobot test-browser lint format docs wheel release bench long-compare long-demo long-speed long-ray long-reading long-growth long-adversaries long-noise long-calls long-edits long-calibration long-coverage long-power long-policies long-policy-draws long-lerobot long-act long-checkpoints long-diffusion long-serve long-endpoints long-series long-gpu long-inspect long-replies long-marks long-falls long-doors long-atheris long-faults long-fuzz long-watch long-page long-kills long-rulings mutants clean

help:
	@echo "make demo         verdicts on sixteen known-answer controllers, offline"
	@echo "make demo-vlm     the same on five tiny real vision-language models, on a CPU, offline once installed"
	@echo "make demo-policy  the same on six tiny trained robot policies, offline"
	@echo "make ladder       the baselines of the closed loop beside the paper's, offline, in a few minutes"
	@echo "make hierarchy    intents above a model-predictive controller beside the paper's tables, offline"
	@echo "make test         the tests of the core"
	@echo "make test-slow    the core's long tests: whole studies, runs that are killed, adversaries, pages that say how to add something"
	@echo "make test WITH_SLOW=1  both of these in one go, which costs less than one after the other"
	@echo "make test-models  the tests that need extras (Hugging Face datasets, Parquet, LeRobot, Transformers, Ray)"
	@echo "make test-lerobot the tests that ask LeRobot itself, in the Python that EYECHART_LEROBOT_PYTHON names"
	@echo "make test-browser the report in headless Chromium, which has to be there (apt-get install chromium)"
	@echo "make extras       what test-models, test-browser and docs need, installed at once"
	@echo "make lint         ruff and mypy"
	@echo "make docs         the site, in build/docs"
	@echo "make wheel        both distributions, in dist, their contents checked, and tried in a fresh environment"
	@echo "make release      the same, tried in each of PYTHONS ($(PYTHONS)), the demo in the first"
	@echo "make bench        ratios against what one would otherwise do"
	@echo "make long-compare 0.1.0, installed beside, and this version make the same studies: what differs, by key"
	@echo "make long-adversaries  adversaries and readers on fresh banks through the real run and in simulated worlds, beside their truth"
	@echo "make long-noise   paired runs of readers and near misses in simulated worlds: does a coin buy a stronger label?"
	@echo "make long-calls   how many calls each kind of controller takes, on the source of 0.2.0.dev0 and on today's"
	@echo "make long-edits   banks edited from photographs beside rendered ones: labels of 15 controllers, errors of gaps, holes"
	@echo "make long-calibration  200 simulated banks of each setting, judged: docs/calibration.md anew"
	@echo "make long-power   the power that a plan prints, against models that are drawn, scored and judged"
	@echo "make long-replies  a million replies made from the corpus by mutation, each read: no exception, no guess"
	@echo "make long-marks  the replies of numbers, letters and phrases that were kept: what the reader makes of them"
	@echo "make long-falls   the tests of what fell in 0.2.0.dev0, on its source and on today's: each fails there, and passes now"
	@echo "make long-doors   every door under every fault that fits it, on the source of 0.2.0.dev0 and on today's: what each finds"
	@echo "make long-atheris what parses bytes of others, fuzzed by coverage, MINUTES=10 a target"
	@echo "make long-faults a battery through every fault of the road at random, killed again and again: nothing lost, one verdict"
	@echo "make long-kills  two hundred kills over run, merge, import, bundle, --watch, calibrate and ladder: nothing lost or left"
	@echo "make long-rulings what the rows of the rules say of 60,000 random evidences an axis, and what the functions before them said"
	@echo "make long-fuzz   broken ledgers, modes, prompts, tables, guardians, bundles, banks and data sets: an error in words each"
	@echo "make long-watch  a run with --watch and one without beside a slow server, in pairs: first answers, processor time"
	@echo "make long-page   the page of 20 models on 288 frames under 15 conditions: its size, and the time to open it in Chromium"
	@echo "make long-serve   a served guardian under hostile load, against the table of classes of replies"
	@echo "make long-series   series of corruptions on readers of known acuity: is the last step found?"
	@echo "make long-endpoints  doctor, probe, battery and verdict on every way of serving (LITELLM=, TRANSFORMERS=, LLAMA=, URL=)"
	@echo "make long-gpu    the arm of Transformers on a GPU: labels of the CPU, ways of loading, memory, energy, faults"
	@echo "make long-inspect a battery under Inspect AI, and one asked by hand from a table, against the native run, by statistic"
	@echo "make long-policies  the rules on policies, in simulated settings that were fixed before"
	@echo "make long-policy-draws  the trained policies again: other draws, other episodes, other numbers of threads"
	@echo "make long-lerobot   a data set by LeRobot's own writer, from import to gate: verdicts, time and memory"
	@echo "make long-act       LeRobot's ACT, trained with and without a state that tells it all: opposite verdicts"
	@echo "make long-checkpoints  LeRobot's own data sets to the bit; ACT, VQ-BeT and Diffusion as lerobot:CHECKPOINT, from import to gate"
	@echo "make long-diffusion LeRobot's DiffusionPolicy, asked with one seed and without: are the verdicts equal?"
	@echo "make long-coverage how often each printed interval holds a known truth, and how wide it is"
	@echo "make mutants      small faults put into the rules and the statistics one at a time: how many the tests notice"
	@echo "make long-demo    processor time of the demo in 0.1.0 and in this version, in pairs, and its verdicts on five seeds"
	@echo "make long-reading processor time of the commands that read a run, against a hello-world with numpy"
	@echo "make long-growth  processor time and memory of verdict and costs over frames, models and calls, with exponents"
	@echo "make long-ray     ten minutes of work in one process and over two workers of Ray: processor time, rows, verdict"
	@echo "make long-speed   processor time of commands in 0.1.0 and in this version, in pairs"

demo: $(CORE)
	$(BIN)/eyechart demo --out demo

demo-vlm: $(VLM)
	$(BIN)/eyechart demo --vlm --out demo

demo-policy: $(CORE)
	$(BIN)/eyechart demo --policy --out demo

hierarchy: $(CORE)
	$(BIN)/eyechart run hierarchy --out hierarchy --processes 2

ladder: $(CORE)
	$(BIN)/eyechart ladder --out ladder --processes 2

# As many tests at once as there are workers, the longest files first, and each file's tests in one worker.
SPREAD = -n $(WORKERS) --dist loadfile --no-loadscope-reorder --max-worker-restart 0

test: $(DEV)
	$(BIN)/python -m pytest $(SPREAD) -m "not models and not browser and not lerobot$(if $(WITH_SLOW),, and not slow)"

test-slow: $(DEV)
	$(BIN)/python -m pytest $(SPREAD) -m "slow and not models and not browser and not lerobot"

test-models: $(MODELS)
	EYECHART_EXTRAS=required $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --max-worker-restart 0 -m models

test-lerobot: $(MODELS)
	@test -n "$(EYECHART_LEROBOT_PYTHON)" || { echo "EYECHART_LEROBOT_PYTHON names a Python that has lerobot[dataset,diffusion]"; exit 1; }
	EYECHART_EXTRAS=required $(BIN)/python -m pytest tests/extras -m lerobot

test-browser: $(BROWSER)
	@test -n "$${EYECHART_CHROMIUM:-$(CHROMIUM)}" || \
	  { echo "Chromium is not there: 'apt-get install chromium', or EYECHART_CHROMIUM=/path/to/one make test-browser"; exit 1; }
	EYECHART_EXTRAS=required EYECHART_CHROMIUM="$${EYECHART_CHROMIUM:-$(CHROMIUM)}" $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder --max-worker-restart 0 -m browser

lint: $(DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: $(DEV)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# What continuous integration checks needs no list of each page's names beside it, which takes a third of the build, and
# no defaults as the source writes them, for which the source of each function is parsed again.
docs: $(DOCS)
	$(BIN)/python -m sphinx -E -W --keep-going -q $(if $(SHORT),-D toc_object_entries=0 -D autodoc_preserve_defaults=0 )-b html docs build/docs
	$(BIN)/python docs/check_site.py build/docs

# Both distributions, their contents checked, and tried in a fresh environment of the Python that make uses; for a release
# in one of every Python that is promised, also pyenv's. IF_THERE=--if-there names one that is missing, and goes on.
PYTHONS ?= python3.11 python3.12 python3.13
release: TRIED := $(IF_THERE) $(PYTHONS)

wheel: $(CORE)
	rm -rf dist build/lib build/bdist.* organisms/build
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps -w dist . ./organisms
	$(BIN)/python tests/check_wheel.py dist/*.whl
	$(BIN)/python tests/try_wheel.py dist $(TRIED)

release: wheel

# Each to its end, whatever the one before it found.
bench: $(BENCH) $(INSPECT)/.done
	@missed=; for one in statistics bank "drives --seeds 1 --pictures --processes" positive_control score guardian mpc serve hf \
	  calibrate "calls --inspect-python $(INSPECT)/bin/python"; do \
	  set -- $$one; name=$$1; shift; \
	  echo "bench_$$name"; $(BIN)/python benchmarks/bench_$$name.py "$$@" || missed="$$missed bench_$$name"; \
	done; test -z "$$missed" || { echo "a bound is missed by$$missed"; exit 1; }

# The version before, beside this one; OLD_PYTHON=/its/python takes one that is installed already.
OLD_COMMIT := 201be47
TRIED_COMMIT := 066353c3
OLD := build/0.1.0
OLD_PYTHON ?= $(OLD)/.venv/bin/python

long-demo: $(CORE) $(OLD_PYTHON)
	$(BIN)/python benchmarks/demo_versions.py --old $(OLD_PYTHON)

long-falls: $(MODELS)
	test -d build/0.2.0.dev0/benchmarks || { mkdir -p build/0.2.0.dev0 && git archive $(TRIED_COMMIT) | tar -x -C build/0.2.0.dev0; }
	$(BIN)/python benchmarks/falls.py --old build/0.2.0.dev0/src

long-doors: $(MODELS)
	test -d build/0.2.0.dev0 || { mkdir -p build/0.2.0.dev0 && git archive $(TRIED_COMMIT) src | tar -x -C build/0.2.0.dev0; }
	$(BIN)/python benchmarks/doors.py --old build/0.2.0.dev0/src

MINUTES ?= 10

long-atheris: $(FUZZ)
	$(BIN)/python benchmarks/atheris_doors.py --minutes $(MINUTES)

long-compare: $(CORE) $(OLD_PYTHON)
	$(BIN)/python benchmarks/compare_versions.py --old $(OLD_PYTHON)

long-reading: $(CORE)
	$(BIN)/python benchmarks/bench_reading.py

long-ray: $(MODELS)
	$(BIN)/python benchmarks/ray_workers.py

long-growth: $(CORE)
	$(BIN)/python benchmarks/growth.py

long-speed: $(CORE) $(OLD_PYTHON)
	$(BIN)/python benchmarks/speed_versions.py --old $(OLD_PYTHON)

long-watch: $(CORE)
	$(BIN)/python benchmarks/live_watch.py

long-page: $(BROWSER)
	EYECHART_CHROMIUM="$${EYECHART_CHROMIUM:-$(CHROMIUM)}" $(BIN)/python benchmarks/large_page.py

long-rulings: $(CORE)
	$(BIN)/python benchmarks/old_rulings.py

long-coverage: $(CORE)
	$(BIN)/python benchmarks/long_coverage.py
	$(BIN)/python benchmarks/coverage_kinds.py

long-adversaries: $(CORE)
	$(BIN)/python benchmarks/adversarial_runs.py

long-noise: $(CORE)
	$(BIN)/python benchmarks/noise_paid.py

long-calls: $(CORE)
	test -d build/0.2.0.dev0 || { mkdir -p build/0.2.0.dev0 && git archive $(TRIED_COMMIT) src | tar -x -C build/0.2.0.dev0; }
	$(BIN)/python benchmarks/calls_by_kind.py

long-edits: $(CORE)
	$(BIN)/python benchmarks/edited_banks.py

long-calibration: $(CORE)
	mkdir -p build
	$(BIN)/eyechart calibrate --replications 200 --keep build/calibration.jsonl --json > build/calibration.json || test $$? = 1
	$(BIN)/python docs/update_calibration.py build/calibration.json

mutants: $(MUTANTS)
	$(BIN)/python benchmarks/mutants.py

long-policies: $(CORE)
	$(BIN)/python benchmarks/policy_rules.py

long-policy-draws: $(CORE)
	$(BIN)/python benchmarks/policy_draws.py

long-lerobot: $(MODELS)
	$(BIN)/python benchmarks/lerobot_policy.py

long-act:
	@test -n "$(LEROBOT_PYTHON)" || { echo "LEROBOT_PYTHON names a Python that has LeRobot and eyechart"; exit 2; }
	$(LEROBOT_PYTHON) benchmarks/act_tabletop.py

long-checkpoints:
	@test -n "$(LEROBOT_PYTHON)" || { echo "LEROBOT_PYTHON names a Python that has lerobot[dataset,diffusion] and eyechart"; exit 2; }
	$(LEROBOT_PYTHON) benchmarks/lerobot_checkpoints.py

long-diffusion:
	@test -n "$(LEROBOT_PYTHON)" || { echo "LEROBOT_PYTHON names a Python that has lerobot[diffusion] and eyechart"; exit 2; }
	$(LEROBOT_PYTHON) benchmarks/diffusion_tabletop.py

long-power: $(CORE)
	$(BIN)/python benchmarks/planned_power.py

long-replies: $(CORE)
	$(BIN)/python benchmarks/fuzzed_replies.py

long-marks: $(CORE)
	$(BIN)/python benchmarks/kept_replies.py

long-series: $(CORE)
	$(BIN)/python benchmarks/series_acuity.py

long-faults: $(CORE)
	$(BIN)/python benchmarks/broken_roads_run.py

long-kills: $(CORE)
	$(BIN)/python benchmarks/kills.py

long-fuzz: $(MODELS)
	$(BIN)/python benchmarks/fuzzed_files.py

long-endpoints: $(CORE)
	$(BIN)/python benchmarks/every_server.py --litellm "$(LITELLM)" --transformers "$(TRANSFORMERS)" --llama "$(LLAMA)" --url "$(URL)"

long-gpu: $(VLM)
	$(BIN)/python benchmarks/gpu_arms.py

long-inspect: $(MODELS) $(INSPECT)/.done
	$(INSPECT)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps .
	$(BIN)/python benchmarks/inspect_battery.py --inspect $(INSPECT)/bin/inspect

long-serve: $(CORE)
	$(BIN)/python benchmarks/hostile_serve.py

$(OLD)/.venv/bin/python:
	rm -rf $(OLD) && mkdir -p $(OLD)
	git archive $(OLD_COMMIT) | tar -x -C $(OLD)
	$(PYTHON) -m venv $(OLD)/.venv
	$(OLD)/.venv/bin/python -m pip install --quiet --disable-pip-version-check -c $(OLD)/constraints.txt -e $(OLD)

clean:
	rm -rf $(VENV) demo ladder hierarchy build dist organisms/build

# ON=.venv makes an environment that sees the packages of that one too, pip among them, and installs only what it lacks.
# The pip that comes with a Python may be an old one, which takes twice as long to choose among all versions.
$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "eyechart needs Python 3.11 or newer; give it with: make PYTHON=python3.11 ..."; exit 1; }
	$(PYTHON) -m venv $(if $(ON),--without-pip )$(VENV)
	$(if $(ON),,$(PIP) pip)
	$(if $(ON),there=$$(realpath $(ON)/lib/python*/site-packages) && cd $(VENV)/lib/python*/site-packages && echo "$$there" > on.pth)

$(CORE): $(VENV)/bin/python $(PROJECTS) constraints.txt
	$(PIP) -e . -e ./organisms
	@touch $@

$(DEV): $(VENV)/bin/python $(PROJECTS) constraints.txt
	$(PIP) -e '.[dev]' -e ./organisms
	@touch $(CORE) $@

$(VLM): $(CORE)
	$(PIP) -e '.[transformers]'
	@touch $@

$(MODELS): $(DEV)
	$(PIP) -e '.[dev,hub,parquet,lerobot,hdf5,film,transformers,serve,ray]'
	@touch $@

# All that the checks need, in one go, where all of them are run: continuous integration.
$(EXTRAS): $(VENV)/bin/python $(PROJECTS) constraints.txt
	$(PIP) -e '.[dev,hub,parquet,lerobot,hdf5,film,transformers,serve,ray,docs,browser]' -e ./organisms
	@touch $(CORE) $(DEV) $(MODELS) $(DOCS) $(BROWSER) $@

extras: $(EXTRAS)

$(DOCS): $(CORE)
	$(PIP) -e '.[docs]'
	@touch $@

$(BROWSER): $(DEV)
	$(PIP) -e '.[dev,browser]'
	@touch $@

$(BENCH): $(DEV)
	$(PIP) -e '.[dev,bench,transformers]'
	@touch $@

$(FUZZ): $(DEV)
	$(PIP) -e '.[dev,fuzz]'
	@touch $@

$(MUTANTS): $(DEV)
	$(PIP) -e '.[dev,mutants]'
	@touch $@

# What the benchmarks of calls and of Inspect compare with has requirements of its own, which the versions above do not meet.
$(INSPECT)/.done: $(VENV)/bin/python
	$(PYTHON) -m venv $(INSPECT)
	$(INSPECT)/bin/python -m pip install --quiet --disable-pip-version-check inspect-ai==0.3.285 openai==3.54.0
	@touch $@
