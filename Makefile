# Two commands do everything: `make eval METHOD=3dgs` and `make test`.
PYTHON  ?= python3.11
VENV    ?= .venv
METHOD  ?= 3dgs
SCENE   ?= courtyard
SUITE   ?=
CAPTURES ?=
PROFILE ?= demo
SEED    ?= 0
TRACK   ?= given-poses
PATTERNS ?=
DATA    ?= data
RESULTS ?= results
EXTRAS  ?= blender,viewer,compression,cuda,dev
SEEDS   ?= 0
PHOTOGRAPHS ?=
BENCH   ?= splatting
BENCH_ARGS ?=
PIP_ARGS ?=
RUN     ?=
PORT    ?= 8080
OUT     ?= film.mp4
EXAMPLES ?= 1000
FILM_ARGS ?=

ABLATION := deraings.method:Masks 3dgs+enhance deraings.method:WithoutAttention deraings \
            deraings.method:RainModelOnly deraings-plus deraings.method:Everything
EFFECTS  := dark haze night raindrop raindrop-b raindrop-renewed raindrop-sharp shower storm streak streak-b window
BOARD_PAGES := README.md docs/leaderboard/results.md
METHODS  ?= 3dgs nerf-w derain-nerf wild-gaussians gs-w deraings deraings-plus
SCENES   ?=
BIN      := $(VENV)/bin
KERNEL_TESTS := $(addprefix tests/baselines/splatting/,test_rasterizer.py test_hard_cases.py kernels/test_photometric.py)
READY    := $(VENV)/.ready
DOCS     := $(VENV)/.ready-docs

# Whoever sets up with settings of their own means the environment that is there, too.
own       = $(filter command environment,$(firstword $(origin $(1))))
ifneq ($(and $(filter setup,$(MAKECMDGOALS)),$(strip $(foreach name,PYTHON EXTRAS PIP_ARGS,$(call own,$(name))))),)
  .PHONY: $(READY)
endif
anew     := $(if $(call own,PYTHON),--clear)

# Settings reach the programs as they were given: make does not expand what is in them, and no shell reads it.
GIVEN    := METHOD SCENE PROFILE SEED TRACK DATA RESULTS SEEDS METHODS BENCH PORT OUT EXTRAS
OPTIONAL := SUITE CAPTURES PATTERNS PHOTOGRAPHS RUN SCENES OVERWRITE REPAIR RENDER BENCH_ARGS PIP_ARGS FILM_ARGS
$(foreach name,$(GIVEN) $(OPTIONAL),$(eval override $(name) := $$(value $(name))))
define newline


endef
comma    := ,
quote     = '$(subst ','\'',$(1))'
quoted    = $(foreach one,$(1),$(call quote,$(one)))
names    := $(call quoted,$(subst $(comma), ,$(PATTERNS)))
patterns := $(if $(names),--patterns $(names))
overwrite := $(if $(filter 1,$(OVERWRITE)),--overwrite)
repair   := $(if $(filter 1,$(REPAIR)),--repair)
render   := $(if $(filter 1,$(RENDER)),--render)
scenes   := $(if $(SCENES),$(call quoted,$(SCENES)),$(call quote,$(SCENE)))
every_pattern = $(foreach effect,$(EFFECTS),$(effect)-0 $(effect)-1 $(effect)-2)
what     := $(if $(SUITE),--suite $(call quote,$(SUITE)),$(call quote,$(SCENE)))
profile  := $(call quote,$(PROFILE))
data     := $(call quote,$(DATA))
results  := $(call quote,$(RESULTS))
sweep     = trap 'exit 130' INT TERM; bad=; \
            for seed in $(call quoted,$(SEEDS)); do for scene in $(scenes); do for method in $(call quoted,$(1)); do \
            $(MAKE) eval METHOD="$$method" SCENE="$$scene" SEED="$$seed" || bad="$$bad $$method,$$scene,$$seed"; \
            done; done; done; test -z "$$bad" || { echo "not finished:$$bad" >&2; exit 1; }
enhance   = $(BIN)/python -m deraings.enhancement train --photographs $(call quote,$(PHOTOGRAPHS)) \
            --cache $(results)/enhancement/rain

ifneq ($(CAPTURES),)
export HYDROVIEWS_CAPTURES := $(CAPTURES)
endif

required  = $(if $(filter $(2),$(MAKECMDGOALS)),$(if $(strip $($(1))),,$(error $(1)= is missing: $(3))))
$(foreach name,$(GIVEN),$(if $(strip $($(name))),,$(error $(name)= is empty)))
$(foreach name,$(GIVEN) $(OPTIONAL),$(if $(findstring $(newline),$($(name))),$(error $(name)= has a line break in it)))
$(call required,RUN,view film,name the folder of a finished run such as RUN=$(RESULTS)/demo/3dgs/courtyard/raindrop-1/seed-0)
$(call required,PHOTOGRAPHS,enhancer drop-finder,name a folder of clean photographs)

ifneq ($(and $(SUITE),$(filter eval,$(MAKECMDGOALS))),)
$(error SUITE=$(SUITE): make eval takes one SCENE= at a time; SUITE= is for make dataset)
endif

ifneq ($(filter-out 0 1,$(OVERWRITE)),)
$(error OVERWRITE=$(OVERWRITE): 1 to build and run anew what is there with other settings; 0 or nothing to keep it)
endif
ifneq ($(filter-out 0 1,$(REPAIR)),)
$(error REPAIR=$(REPAIR): 1 to make changed files of a finished scene again; 0 or nothing to refuse it)
endif
ifneq ($(filter-out 0 1,$(RENDER)),)
$(error RENDER=$(RENDER): 1 to render an embedded scene that the package has as rendered; 0 or nothing to unpack it)
endif

.PHONY: setup dataset eval compare check severity enhancer drop-finder ablation leaderboard view film board bench docs test fuzz test-simd lint

setup: $(READY)  ## install everything into .venv, at the versions of constraints.txt

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(strip $(anew) $(VENV))
	$(BIN)/python -m pip install --upgrade --constraint constraints.txt pip setuptools
	$(BIN)/python -m pip install --constraint constraints.txt $(call quoted,$(PIP_ARGS)) --editable $(call quote,.[$(EXTRAS)])
	touch $(READY)

dataset: $(READY)  ## build the clean views, cameras and rainy variants of SCENE=, or of every scene of SUITE=
	$(BIN)/python -m hydroviews build $(what) --profile $(profile) --out $(data)/$(profile) --seed $(call quote,$(SEED)) $(patterns) $(overwrite) $(repair) $(render)

eval: $(READY)  ## build what is missing, run the method and the reference rows, print the table
	$(BIN)/python -m hydroviews eval $(call quote,$(METHOD)) --scene $(call quote,$(SCENE)) --profile $(profile) --seed $(call quote,$(SEED)) --track $(call quote,$(TRACK)) --data $(data) --results $(results) $(patterns) $(overwrite)

check: $(READY)  ## check that METHOD= keeps the contract of methods, on a small room; takes seconds
	$(BIN)/python -m leaderboard check $(call quote,$(METHOD)) --profile $(profile)

severity: $(READY)  ## measure what plain 3DGS loses to each pattern, or to PATTERNS=, write the losses into data cards, and suggest values of capture.json that meet the grades
	$(MAKE) eval METHOD=3dgs $(if $(names),,PATTERNS='$(strip $(every_pattern))')
	$(BIN)/python -m leaderboard table --results $(results) --cards $(data)/$(profile)

enhancer: $(READY)  ## train the enhancement network on PHOTOGRAPHS=, a folder of clean photographs
	$(enhance) --out $(results)/enhancement/first
	$(enhance) --out $(results)/enhancement/second --start $(results)/enhancement/first/weights.safetensors \
		--seed 1 --steps 8000
	$(enhance) --out $(results)/enhancement/small --start $(results)/enhancement/second/weights.safetensors \
		--seed 2 --steps 6000 --sides 480 384 288 --lenses 20

drop-finder: $(READY)  ## train the network that detects drops for derain-nerf, on PHOTOGRAPHS=, a folder of clean photographs
	$(BIN)/python -m baselines.derain_nerf.raindrop_attention train --photographs $(call quote,$(PHOTOGRAPHS)) --cache $(results)/enhancement/rain --out $(results)/raindrop-attention/small

compare: $(READY)  ## run METHODS="..." (default: seven methods of the Makefile) on SCENES="..." or SCENE=, for each seed of SEEDS="0 1 2"
	+$(call sweep,$(METHODS))

ablation: $(READY)  ## run DeRainGS, DeRainGS without single parts, and deraings-plus; the same options as compare
	+$(call sweep,$(ABLATION))

leaderboard: $(READY)  ## gather all records into results/leaderboard.csv, tables and pages; open results/site/index.html
	$(BIN)/python -m leaderboard table --results $(results)
	$(BIN)/python -m leaderboard site --results $(results) --data $(data)

board: $(READY)  ## write tables and pages of the published runs, and fill README's table; open build/board/site/index.html
	$(BIN)/python -m leaderboard board --pages $(BOARD_PAGES)

view: $(READY)  ## show a trained scene in a browser: RUN=results/... [PORT=8080]
	$(BIN)/python -m leaderboard view $(call quote,$(RUN)) --data $(data) --port $(call quote,$(PORT))

film: $(READY)  ## render a film of a trained scene: RUN=results/... [OUT=film.mp4] [FILM_ARGS="--seconds 8 --fps 30 --size 800"]
	$(BIN)/python -m leaderboard film $(call quote,$(RUN)) --data $(data) --out $(call quote,$(OUT)) $(call quoted,$(FILM_ARGS))

bench: $(READY)  ## run a benchmark: BENCH=splatting; `python -m benchmarks` lists all
	$(BIN)/python -m benchmarks $(call quote,$(BENCH)) $(call quoted,$(BENCH_ARGS))

$(DOCS): $(READY)
	$(BIN)/python -m pip install --constraint constraints.txt --editable '.[docs]'
	touch $(DOCS)

docs: $(DOCS)  ## build the documentation and the board's pages; open build/site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build
	$(BIN)/python -m leaderboard board --out build/site/board --docs ../../

# A file's tests share what they build, so they stay in one process; tests/conftest.py has the order of files.
test: $(READY)  ## run all tests, in up to four processes
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder --durations=25

fuzz: $(READY)  ## read damaged captures and pictures, newly drawn, EXAMPLES=1000 per reader
	FUZZ_EXAMPLES=$(EXAMPLES) $(BIN)/python -m pytest tests/hydroviews/formats/test_fuzzed_readers.py

test-simd: $(READY)  ## run the tests of the kernels with each instruction set of the processor
	simds=$$($(BIN)/python -c "from baselines.splatting.kernels.simd import available; print(*available())") || exit 1; \
	for simd in $$simds; do \
	  HYDROVIEWS_SIMD=$$simd $(BIN)/python -m pytest -q -n auto --maxprocesses 4 $(KERNEL_TESTS) || exit 1; done

lint: $(READY)  ## run ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
