PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
KILLS ?= 100
CASES ?= 10000

# What a change needs every time: it takes about a minute.
QUICK := model jit kernels features screen clutter calibrate scoring report method/test_method.py recipe/test_recipe.py \
    simulate/test_spread.py simulate/test_echoes.py simulate/test_shadow.py docs/test_docs_pages.py test_imports.py

# Whole files go to three processes, heavy ones first (tests/conftest.py): on two cores, for some wait much of their time.
PYTEST := $(BIN)/python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

LINT := $(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/mypy

# The checks go on beside the tests; what they say comes last.
# $(1): the command of the tests.
define beside_the_checks
@log=$$(mktemp); { $(LINT); } > $$log 2>&1 & checks=$$!; \
trap 'kill $$checks 2> /dev/null; rm -f $$log' EXIT; trap 'exit 130' INT TERM; \
$(1); tests=$$?; wait $$checks; lint=$$?; cat $$log; \
test $$lint = 0 || echo "make lint failed: see above"; test $$tests = 0 || echo "the tests failed: see above"; \
exit $$((lint || tests))
endef

# Without compiled modules each of the many processes that the tests start would compile them anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo benchmark bench quick test test-slow test-full lint docs robustness oldest newest wheel-check sbom clean

# Opens the report in the browser where there is a display.
demo: $(VENV)/.core
	$(BIN)/flgpr demo -o demo-result

# Detectors side by side on the quick form of the proving ground, both tiers: some five minutes.
benchmark: $(VENV)/.benchmark
	$(BIN)/flgpr benchmark run --quick --workers 2 -o proving-ground

# The imaging operator beside the machine's limits; ARGS=--peers: and beside other codes.
bench: $(VENV)/.bench
	$(BIN)/python benchmarks/imaging_speed $(ARGS)

quick: $(VENV)/.test
	$(call beside_the_checks,$(PYTEST) -q -m "not slow" $(addprefix tests/,$(QUICK)))

test: $(VENV)/.test
	$(call beside_the_checks,$(PYTEST) -m "not slow")

# What `make test` leaves out; pyproject.toml says what "slow" means.
test-slow: $(VENV)/.test
	$(PYTEST) -m slow

test-full: test test-slow

lint: $(VENV)/.test
	$(LINT)

# Tests of what docs/evidence/guarantees.md promises.
ROBUSTNESS := robustness health/test_faults_told.py test_bounds.py method/test_demo.py commands/test_commands_errors.py \
    commands/test_doubts.py commands/test_health_told.py commands/test_implausible_poses.py \
    ground/test_scorers.py ground/test_submission.py live/test_live_health.py viewer/test_approaches.py \
    exchange/test_fuzz_exchange.py live/test_event_rate.py live/test_live_fuzz.py live/test_live_machines.py \
    live/test_live_positions.py live/test_secret.py live/test_senders.py live/test_session.py live/test_sockets.py \
    live/test_watch.py \
    model/test_motion.py model/test_plausible.py store/test_csv_formulas.py store/test_lists_taken_wrong.py store/test_outputs.py \
    store/test_run_races.py store/test_run_store.py store/test_store_machines.py store/test_table_widths.py trials/test_ledger.py viewer/test_limits.py \
    viewer/test_server.py

# Many more random kills and damaged files than `make test-slow` tries.
robustness: $(VENV)/.test
	FLGPR_KILLS=$(KILLS) FLGPR_CASES=$(CASES) FLGPR_APPROACHES=20 $(PYTEST) $(addprefix tests/,$(ROBUSTNESS))

# The oldest versions that pyproject.toml allows, on the oldest Python, and the newest versions there are, on $(PYTHON):
# imports, the demo, detection with its estimators, stores, formats, commands and live scans work with both.
OLDEST_PYTHON ?= python3.11
NEWEST_PYTHON ?= $(PYTHON)
VERSIONS := test_imports.py test_lazy.py test_main.py test_system.py method recipe stages detect formats exchange geo live/test_session.py live/test_sockets.py \
    report/test_score_page.py results scoring store systems/test_systems.py viewer/test_server.py \
    $(addprefix commands/test_,detect.py help.py importing.py info.py options.py scoring.py simulate.py)
# What of these takes long and rests on no library's version: mathematics of ours, and drawn cases.
NOT_VERSIONS := method/test_goldens.py recipe/test_recipe_for_run.py recipe/test_recipe_like.py \
    exchange/test_fuzz_exchange.py exchange/test_gpr_notes_property.py exchange/test_notes_property.py \
    live/test_live_fuzz.py live/test_live_machines.py live/test_live_positions.py live/test_senders.py \
    scoring/test_bootstrap.py papers/test_kit_boxes.py scoring/test_chance_level.py scoring/test_comparison.py \
    scoring/test_lane_roc.py stages/test_earlier_runs.py store/test_store_machines.py trials/test_planning.py

# $(1): folder of the environment; $(2): its Python; $(3): options of uv, which unlike pip can choose the oldest versions
define install_versions
	test -x $(1)/bin/python || $(2) -m venv $(1)
	$(1)/bin/python -m pip install --quiet --disable-pip-version-check uv
	$(1)/bin/uv pip install --quiet --python $(1)/bin/python $(3) -e '.[test]'
	$(1)/bin/python -P -m flgpr.kernels.ahead training < /dev/null
endef

# $(1): folder of the environment; $(2): options of pytest
test_versions = $(1)/bin/python -m pytest -q -n 3 --dist loadfile --no-loadscope-reorder $(2) \
    -m "not slow" $(addprefix tests/,$(VERSIONS)) $(addprefix --ignore=tests/,$(NOT_VERSIONS))

# Versions as old use what newer versions of what they rest on deprecate.
oldest:
	$(call install_versions,$(VENV)-oldest,$(OLDEST_PYTHON),--resolution lowest-direct)
	$(call test_versions,$(VENV)-oldest,-W ignore::DeprecationWarning -W ignore::PendingDeprecationWarning -W ignore::FutureWarning)

# An environment that is there already is brought up to date. Where no library is newer than constraints.txt and the Python
# is the same, `make test` has run with these versions.
newest:
	$(call install_versions,$(VENV)-newest,$(NEWEST_PYTHON),--upgrade)
	@newer=$$($(VENV)-newest/bin/python .ci/newer.py constraints.txt) || exit 1; \
	if test -z "$$newer" -a "$(NEWEST_PYTHON)" = "$(PYTHON)"; then \
	    echo "no library that flgpr needs is newer than constraints.txt"; \
	else \
	    echo "newer than constraints.txt:" $$newer; $(call test_versions,$(VENV)-newest,); \
	fi

wheel-check:
	tests/check_wheel.sh $(PYTHON)

docs: $(VENV)/.docs
	$(BIN)/codespell *.md docs src tests benchmarks evidence examples viewer
	$(BIN)/python -m sphinx -W --keep-going -b html docs docs/_build/html

# The bill of materials (CycloneDX) of what `pip install flgpr` installs: an environment that holds nothing else, and the
# tool that reads it in another.
SBOM := $(VENV)/sbom

sbom:
	rm -rf $(SBOM)
	$(PYTHON) -m venv $(SBOM)/tool
	$(SBOM)/tool/bin/python -m pip install --quiet --disable-pip-version-check 'cyclonedx-bom~=7.5'
	$(PYTHON) -m venv --without-pip $(SBOM)/core
	$(SBOM)/tool/bin/python -m pip --python $(SBOM)/core/bin/python install --quiet --disable-pip-version-check \
	    -c constraints.txt .
	mkdir -p dist
	$(SBOM)/tool/bin/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible --short-PURLs \
	    --output-file dist/flgpr.cdx.json $(SBOM)/core/bin/python
	rm -rf $(SBOM)

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

# Kernels of a detection are compiled while pip installs the rest: the compiler stops when the pipe from pip is closed.
# $(1): extras to install; $(2): what else to compile, which for the linear algebra of trainings asks for SciPy.
define install_and_compile
	$(PIP) numba portalocker $(if $(2),scipy)
	rm -f $@
	{ $(PIP) -e '.$(1)' >&2 && touch $@; } | PYTHONPATH=src $(BIN)/python -P -m flgpr.kernels.ahead $(2); test -e $@
endef

$(VENV)/.core: $(VENV)/bin/python pyproject.toml constraints.txt
	$(call install_and_compile,)

$(VENV)/.test: $(VENV)/bin/python pyproject.toml constraints.txt
	$(call install_and_compile,[test],training tolerances)

$(VENV)/.benchmark: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e '.[benchmark]'
	touch $@

$(VENV)/.bench: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e '.[bench]'
	touch $@

$(VENV)/.docs: $(VENV)/bin/python pyproject.toml constraints.txt
	$(PIP) -e '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) $(VENV)-oldest $(VENV)-newest build dist docs/_build docs/examples demo-result .mypy_cache .pytest_cache .ruff_cache
