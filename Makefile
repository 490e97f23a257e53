# Two commands: 'make demo' shows the whole system, 'make test' checks it.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: help demo test lint bench compare figures clean

help:
	@echo "make demo     install, run the quick study, print where its report is"
	@echo "make test     install, then lint, type check and all tests"
	@echo "make bench    re-measure the speeds that the documentation quotes"
	@echo "make compare  time exosight beside PyElastica and SoRoMoX again, and show it in docs/validation.md"
	@echo "make figures  re-make the pictures of the README and the documentation"
	@echo "make clean    remove the virtual environment and caches (results stay)"

demo: .venv/ready-train
	$(BIN)/exosight study --preset quick --out results/quick --resume

test: .venv/ready-test lint
	$(BIN)/pytest -n 2 --dist loadfile

lint: .venv/ready-test
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright

bench: .venv/ready-train
	$(BIN)/python -m benchmarks

compare: .venv/ready-test
	$(BIN)/python -m benchmarks.neighbours
	$(BIN)/python docs/figures_validation.py

figures: .venv/ready-test
	$(BIN)/python -m benchmarks.convergence
	$(BIN)/python docs/figures.py
	$(BIN)/python docs/figures_validation.py

.venv/ready-train: pyproject.toml constraints.txt
	@PYTHON="$(PYTHON)" sh tools/setup.sh train

.venv/ready-test: pyproject.toml constraints.txt
	@PYTHON="$(PYTHON)" sh tools/setup.sh train,cluster,compare,test
	@touch .venv/ready-train

clean:
	rm -rf .venv build dist .pytest_cache .ruff_cache .hypothesis
