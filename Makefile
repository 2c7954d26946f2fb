# make look, make demo and make test each work alone on a fresh clone.
RUN := .venv/bin/python run.py
PYTEST := .venv/bin/python -m pytest --numprocesses auto --dist loadfile
# Where the order of a sum can change a number; the contract of the metrics is about integers.
NUMERIC := tests/models tests/metrics tests/test_geometry.py \
	--ignore-glob='*/test_contract.py' --ignore-glob='*/test_hugging*' --ignore-glob='*/test_suite.py' \
	--ignore-glob='*/test_protocol.py' --ignore-glob='*/test_export.py'
export PYTHON

.PHONY: setup setup-dev look demo test test-studies test-processors test-slow lint api clean

# Any Python 3 can run install.py, which finds the one for .venv and says what is missing.
define install
	@for python in python3.11 python3.12 python3.13 python3.10 python3 python3.14 python3.9 \
			.venv/bin/python "$$PYTHON"; do \
		"$$python" -c '' 2>/dev/null && exec "$$python" install.py $(1); \
	done; \
	command -v uv >/dev/null && exec uv run --quiet --no-project --python 3.11 install.py $(1); \
	echo "error: no Python here; install python3.11 with its module venv, or uv" >&2; exit 1
endef

setup:
	$(call install)

setup-dev:
	$(call install,dev)

look: setup
	@$(RUN) task=look

demo: setup
	@$(RUN) +experiment=skyocc

test: setup-dev
	$(PYTEST) -m "not slow"

test-studies: setup-dev
	$(PYTEST) -m "not slow" studies

# The arithmetic of lesser processors, and of two threads; make test has this one's, and one thread.
test-processors: setup-dev
	ATEN_CPU_CAPABILITY=avx2 ONEDNN_MAX_CPU_ISA=AVX2 $(PYTEST) -q -m "not slow" $(NUMERIC)
	ATEN_CPU_CAPABILITY=default ONEDNN_MAX_CPU_ISA=SSE41 OMP_NUM_THREADS=2 OMP_WAIT_POLICY=passive \
		$(PYTEST) -q -m "not slow" $(NUMERIC)

test-slow: setup-dev
	$(PYTEST) -m slow tests studies

lint: setup-dev
	.venv/bin/python -m ruff check .
	.venv/bin/python -m ruff format --check .

# A page of every public class and function, from their docstrings: api/index.html.
api: setup-dev
	.venv/bin/python -m pdoc -o api src.geometry src.ontology src.metrics \
		src.models.stream src.models.frame src.models.checkpoint src.models.export src.models.network \
		src.data.clip src.data.predictions

clean:
	rm -rf .venv .pytest_cache .ruff_cache *.egg-info
