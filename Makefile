# Everything here works on a fresh clone: each target makes what it needs first.
PYTHON ?= python3
BIN := .venv/bin
READY := .venv/ready
TESTABLE := .venv/testable
OLDEST := .venv-oldest

.PHONY: venv motion results pictures test oldest frameworks trust study examples lint bench schema clean

venv: $(READY)

$(READY): pyproject.toml requirements-dev.txt
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-dev.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

# What only tests need: readers of the files that exports write, and a browser to drive.
$(TESTABLE): requirements-test.txt | $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-test.txt
	touch $@

# JAX and PyTorch, which are large; the tests of their exports are skipped without them.
frameworks: venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-frameworks.txt

# One worker a core; a solver of its own in each, so no threads inside. What the browser showed is
# kept in out/screenshots.
test: venv $(TESTABLE)
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 TRUNK_OCP_SCREENSHOTS=out/screenshots \
	  $(BIN)/python -m pytest --numprocesses=2

# The same tests with the oldest versions that pyproject.toml allows, but for those of the page, which
# drive a browser. PyTorch is large: TORCH=torch for it, too.
oldest:
	$(PYTHON) -m venv $(OLDEST)
	$(OLDEST)/bin/python -m pip install --quiet --disable-pip-version-check \
	  --constraint requirements-oldest.txt --editable '.[fast,jax,onnx,symbolic]' $(TORCH) \
	  hypothesis mpmath pygltflib pytest pytest-xdist trimesh vtk
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 \
	  $(OLDEST)/bin/python -m pytest --numprocesses=2 -W ignore --ignore tests/viewer/test_page.py

motion: venv
	$(BIN)/solve-motion pick-fruit

# The committed results: all shipped motions, sequential and horizon.
results: venv
	for motion in lift-log lift-log-asymmetric pick-fruit; do \
	  $(BIN)/solve-motion $$motion --mode both --out results/study/$$motion || exit 1; done

# The pictures of the documentation: a film of the fruit motion, and the figure of conventions.
pictures: venv
	$(BIN)/python docs/pictures.py

# Files made up and damaged, runs killed and resumed, cases validated; TRUST=--inputs=... for more.
trust: venv
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m trust.run $(TRUST)

# What foresight is worth: data and figures in results/foresight, and docs/foresight.md from them.
study: venv
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -m study.run $(STUDY)

# The exported trunk in a control loop.
examples: venv
	PATH="$(BIN):$$PATH" $(BIN)/python examples/follow_target.py

lint: venv
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Everything side by side, some 22 minutes; BENCH=--quick for three. Only this needs the rivals.
bench: venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-bench.txt
	$(BIN)/python -m benchmarks.run $(BENCH)

schema: venv
	$(BIN)/trunk-ocp schema > problems/problem.schema.json

clean:
	rm -rf .venv $(OLDEST)
