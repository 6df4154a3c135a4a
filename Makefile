# Two commands do everything: `make demo` and `make test`. Each sets up what it needs.
PYTHON ?= python3
BIN := .venv/bin
WORKERS ?= 3
KIND ?= polyp
RIG ?= dense
ENGINE ?= model
PYTEST := $(BIN)/python -m pytest

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help setup tools demo live sim test lint bench prove crossings synth-export synth-report clean

help: ## list these targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/\1|\2/p' $(MAKEFILE_LIST) | \
	    while IFS='|' read -r name text; do printf '  make %-13s %s\n' "$$name" "$$text"; done

setup: ## make .venv with everything in it, to the version
	@$(PYTHON) scripts/setup.py

tools:
	@$(PYTHON) scripts/setup.py --test

demo: setup ## simulate a rig, calibrate it, and measure through the RTL
	$(BIN)/python -m scripts.demo

live: setup ## show a simulated rig in a browser, live; KIND=tissue, ENGINE=rtl
	$(BIN)/cyclope view --simulate $(KIND) --rig $(RIG) --engine $(ENGINE) -o out/live-$$(date +%Y%m%d-%H%M%S)

sim: tools ## run the whole-frame benches of the top
	$(PYTEST) tb/system/test_frames.py

test: tools ## run ruff and the regression; FRESH=1: also what is unchanged since it passed
	$(BIN)/ruff check .
	$(PYTEST) -n $(WORKERS) --dist load --maxschedchunk 1 --durations 10 \
	    $(if $(FRESH),,--skip-unchanged) --junitxml=build/regression.xml

lint: tools ## check the Python, the generated Verilog and the VHDL twins
	$(BIN)/ruff check .
	$(PYTEST) tb/system/test_export.py tb/system/test_repository.py

bench: tools ## print speed, accuracy and size
	$(BIN)/python -m tb.benchmark.bench

prove: tools ## prove the laser guard, the streams and the queues, and print the table
	$(BIN)/python -m tb.formal.prove

crossings: setup ## list every path between clock domains, from the netlist
	$(BIN)/python -m scripts.rtl.crossings

synth-export: setup ## write the design for other tools to build/export; FLOW=, PRESET=, SIZE=
	rm -rf build/export
	$(BIN)/cyclope export build/export $(foreach flow,$(FLOW),--flow $(flow)) \
	    $(if $(PART),--part $(PART)) $(if $(PRESET),--preset $(PRESET)) \
	    $(if $(SIZE),--size $(SIZE)) $(if $(BEAMS),--beams $(BEAMS)) \
	    $(if $(LANES),--lanes $(LANES)) $(if $(CALIBRATION),--calibration $(CALIBRATION))

synth-report: tools ## sizes on all parts, printed, drawn and compared; one routed
	$(BIN)/python -m scripts.rtl.report --picture build/synth-report.png

clean: ## remove what was built; .venv stays
	@[ ! -x $(BIN)/python ] || rm -rf "$$($(BIN)/python -m scripts.paths)"
	rm -rf build out .pytest_cache .ruff_cache
