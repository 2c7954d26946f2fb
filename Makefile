# make demo and make test each work alone on a fresh clone.
VENV := .venv
PYTHON := $(VENV)/bin/python
READY := $(VENV)/.ready

.PHONY: setup demo test test-slow lint clean

setup: $(READY)

demo: $(READY)
	$(PYTHON) run.py +experiment=skyocc

test: $(READY)
	$(PYTHON) -m pytest -m "not slow" --numprocesses auto --dist loadfile

test-slow: $(READY)
	$(PYTHON) -m pytest -m slow

lint: $(READY)
	$(PYTHON) -m ruff check .
	$(PYTHON) -m ruff format --check .

# pybullet's wheels stop at Python 3.11: take a 3.11 or 3.10, through uv where it is installed.
$(READY): pyproject.toml constraints.txt
	@if command -v uv >/dev/null; then \
		uv venv --quiet --allow-existing --python 3.11 --seed $(VENV); \
	else \
		for python in python3.11 python3.10 python3; do \
			$$python -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 10), (3, 11)))' \
				2>/dev/null && found=$$python && break; \
		done; \
		if [ -z "$$found" ]; then \
			echo "error: no Python 3.10 or 3.11 here; install python3.11 with its venv package, or uv" >&2; \
			exit 1; \
		fi; \
		$$found -m venv $(VENV); \
	fi
	$(PYTHON) -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $(READY)

clean:
	rm -rf $(VENV) .pytest_cache .ruff_cache *.egg-info
