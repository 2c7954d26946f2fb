# make demo and make test each work alone on a fresh clone.
VENV := .venv
PYTHON := $(VENV)/bin/python
READY := $(VENV)/.ready

PYTEST := $(PYTHON) -m pytest --numprocesses auto --dist loadfile
NUMERIC := tests/models tests/metrics tests/test_geometry.py

.PHONY: setup demo test test-processors test-slow lint clean

setup: $(READY)

demo: $(READY)
	$(PYTHON) run.py +experiment=skyocc

test: $(READY)
	$(PYTEST) -m "not slow"

# The arithmetic of lesser processors, and of two threads; make test has this one's, and one thread.
test-processors: $(READY)
	ATEN_CPU_CAPABILITY=avx2 ONEDNN_MAX_CPU_ISA=AVX2 $(PYTEST) -q -m "not slow" $(NUMERIC)
	ATEN_CPU_CAPABILITY=default ONEDNN_MAX_CPU_ISA=SSE41 $(PYTEST) -q -m "not slow" $(NUMERIC)
	OMP_NUM_THREADS=2 $(PYTEST) -q -m "not slow" $(NUMERIC)

test-slow: $(READY)
	$(PYTHON) -m pytest -m slow

lint: $(READY)
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .

# pybullet's wheels stop at Python 3.11, so 3.11 or 3.10 comes first, through uv where there is one.
# 3.12 and 3.13 do everything but generate data.
$(READY): pyproject.toml constraints.txt
	@if command -v uv >/dev/null; then \
		uv venv --quiet --allow-existing --python 3.11 --seed $(VENV); \
	else \
		for python in python3.11 python3.10 python3.12 python3.13 python3; do \
			$$python -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' \
				2>/dev/null && found=$$python && break; \
		done; \
		if [ -z "$$found" ]; then \
			echo "error: no Python 3.10 to 3.13 here; install python3.11 with its venv package, or uv" >&2; \
			exit 1; \
		fi; \
		$$found -m venv $(VENV); \
	fi
	$(PYTHON) -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $(READY)

clean:
	rm -rf $(VENV) .pytest_cache .ruff_cache *.egg-info
