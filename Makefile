# Thin aliases; without make, call the script with the same word.
PYTHON ?= python3

.PHONY: setup demo test test-slow lint docs benchmark

setup demo test test-slow lint docs benchmark:
	$(PYTHON) scripts/bootstrap.py $@
