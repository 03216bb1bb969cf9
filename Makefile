# Everything here works on a fresh clone: each target makes what it needs first.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready
OLDEST := .venv-oldest
COMPILER := .venv-compiler
MODULE := trunk_ocp/viewer/viewer/physics.wasm
PIP := -m pip install --quiet --disable-pip-version-check
# One thread for each solver: the tests and studies run several processes.
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
# A process that has no more tests takes over half of what is left to the other.
TESTS := --numprocesses=2 --dist=worksteal

.PHONY: help venv motion pictures results test test-fast test-oldest coverage lint docs frameworks trust \
  study examples bench realtime contact module schema lock clean

help:  ## List these targets.
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## (.*)/  make \1\t\2/' | expand -t 20

venv: $(READY)  ## Create .venv with the package and all development tools.

$(READY): pyproject.toml requirements.lock
	$(PYTHON) -m venv .venv
	$(BIN)/python $(PIP) --require-hashes -r requirements.lock
	$(BIN)/python $(PIP) --no-deps --no-build-isolation --editable .
	touch $@

motion: venv  ## Plan pick-fruit and draw it, in results/pick-fruit.
	$(BIN)/solve-motion pick-fruit

pictures: venv  ## Draw the pictures of the documentation.
	$(BIN)/python docs/pictures.py

results: venv  ## Plan the motions of the paper, sequential and horizon, in results/study.
	for motion in lift-log lift-log-asymmetric pick-fruit; do \
	  $(BIN)/solve-motion $$motion --mode both --out results/study/$$motion || exit 1; done

test: venv  ## Run all tests; screenshots of the page go to out/screenshots.
	$(ONE_THREAD) TRUNK_OCP_SCREENSHOTS=out/screenshots $(BIN)/python -m pytest $(TESTS)

test-fast: venv  ## Run the tests that are quick, in a minute.
	$(ONE_THREAD) $(BIN)/python -m pytest $(TESTS) -m "not slow"

# Without the tests of the page, which drive a browser. PyTorch is large: TORCH=torch for it, too.
test-oldest:  ## Run the tests with the oldest versions that pyproject.toml allows.
	$(PYTHON) -m venv $(OLDEST)
	$(OLDEST)/bin/python $(PIP) --constraint requirements-oldest.txt \
	  --editable '.[fast,jax,symbolic]' $(TORCH) \
	  hypothesis mpmath pygltflib pytest pytest-xdist trimesh vtk
	$(ONE_THREAD) $(OLDEST)/bin/python -m pytest $(TESTS) -W ignore --ignore tests/viewer

coverage: venv  ## Run all tests and report which lines they reach.
	$(ONE_THREAD) $(BIN)/python -m pytest $(TESTS) --cov --cov-report=term:skip-covered

lint: venv  ## Check style, types, and the borders between layers.
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: venv  ## Build the documentation in docs/_build/html; every example in it is run.
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet docs docs/_build/html

frameworks: venv  ## Add JAX and PyTorch, for the tests of their exports.
	$(BIN)/python $(PIP) --editable '.[jax,torch]'

trust: venv  ## Try to make it fail: damaged files, interrupts, extreme trunks. TRUST=--inputs=... for more.
	$(ONE_THREAD) $(BIN)/python -m trust.run $(TRUST)

study: venv  ## What foresight is worth: results/foresight, and docs/foresight.md from it.
	$(ONE_THREAD) $(BIN)/python -m study.run $(STUDY)

examples: venv  ## Two control loops: with the exported trunk, and with re-plans.
	PATH="$(BIN):$$PATH" $(BIN)/python examples/follow_target.py
	$(ONE_THREAD) $(BIN)/python examples/track_moving_target.py

bench: venv  ## Compare speed and accuracy with other programs, in 22 minutes; BENCH=--quick for 3.
	$(BIN)/python $(PIP) exudyn nlopt pyelastica PyNomadBBO
	$(BIN)/python -m benchmarks.run $(BENCH)

realtime: venv  ## Whether the planner fits in a control loop: results/realtime.md, in 6 minutes.
	$(ONE_THREAD) $(BIN)/python -m benchmarks.realtime --busy $(REALTIME)

contact: venv  ## What contact costs in each motion: results/contact.md.
	$(ONE_THREAD) $(BIN)/python -m benchmarks.contact

# The compiler is 100 MB to download and 440 MB on disk, so it has a folder of its own.
module: venv  ## Compile the physics of the page, trunk_ocp/viewer/viewer/physics.wasm.
	$(PYTHON) -m venv $(COMPILER)
	$(COMPILER)/bin/python $(PIP) ziglang==0.17.1
	$(BIN)/python -m trunk_ocp.codegen.webassembly $(MODULE) $(COMPILER)/bin/python

schema: venv  ## Write the JSON Schema of problem files.
	$(BIN)/trunk-ocp schema > problems/problem.schema.json

lock: venv  ## Update the pinned development tools in requirements.lock.
	$(BIN)/python $(PIP) uv
	$(BIN)/uv pip compile pyproject.toml --group dev --upgrade --universal --python-version 3.11 \
	  --generate-hashes --no-annotate --quiet --custom-compile-command "make lock" \
	  --output-file requirements.lock

clean:  ## Remove the environments.
	rm -rf .venv $(OLDEST) $(COMPILER)
