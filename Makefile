# Two commands: 'make demo' shows the whole system, 'make test' checks it.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: help demo test lint bench compare figures docs dist clean

help:
	@echo "make demo     install, run the quick study, print where its report is"
	@echo "make test     install, then lint, type check and all tests"
	@echo "make bench    re-measure the speeds that the documentation quotes"
	@echo "make compare  time exosight beside PyElastica, SoRoMoX and MuJoCo again, and show it in docs/validation.md"
	@echo "make figures  re-make the pictures and tables of the README and the documentation"
	@echo "make docs     build the documentation site into site/, warnings as errors"
	@echo "make dist     build wheel and sdist into dist/, install the wheel elsewhere and try it"
	@echo "make clean    remove the virtual environment and caches (results stay)"

demo: .venv/ready-train
	$(BIN)/exosight study --preset quick --out results/quick --resume

test: .venv/ready-test lint
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder

lint: .venv/ready-test
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright

bench: .venv/ready-test
	$(BIN)/python -m benchmarks
	$(BIN)/python -m benchmarks.scaling
	$(BIN)/python -m benchmarks.interpreters
	$(BIN)/python -m benchmarks.own_terms
	$(BIN)/python docs/tables.py
	$(BIN)/python docs/figures_speed.py

compare: .venv/ready-test
	$(BIN)/python -m benchmarks.neighbours
	$(BIN)/python -m benchmarks.rigid
	$(BIN)/python -m benchmarks.belt
	$(BIN)/python docs/figures_validation.py

figures: .venv/ready-test
	$(BIN)/python -m benchmarks.convergence
	$(BIN)/python docs/figures.py
	$(BIN)/python docs/figures_validation.py
	$(BIN)/python docs/figures_identifiability.py
	$(BIN)/python docs/figures_control.py
	$(BIN)/python docs/figures_stress.py
	$(BIN)/python docs/figures_accuracy.py
	$(BIN)/python docs/figures_surface_contact.py
	$(BIN)/python docs/figures_identification.py
	$(BIN)/python docs/figures_animation.py
	$(BIN)/python docs/tables.py
	$(BIN)/python docs/figures_speed.py
	$(BIN)/python tools/dependencies.py

docs: .venv/ready-test
	$(BIN)/python -m sphinx -W --keep-going -b html docs site
	@echo "open site/index.html"

dist: .venv/ready-test
	rm -rf dist
	$(BIN)/python -m build --no-isolation
	EXOSIGHT_TEST_WHEEL=dist $(BIN)/pytest tests/test_distribution.py

.venv/ready-train: pyproject.toml constraints.txt
	@PYTHON="$(PYTHON)" sh tools/setup.sh train,lab

.venv/ready-test: pyproject.toml constraints.txt
	@PYTHON="$(PYTHON)" sh tools/setup.sh train,agents,cluster,compare,docs,gym,lab,lerobot,ros,test
	@touch .venv/ready-train

clean:
	rm -rf .venv build dist site docs/api docs/tutorials_run .pytest_cache .ruff_cache .hypothesis
