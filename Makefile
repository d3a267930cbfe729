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
METHODS  ?= 3dgs nerf-w derain-nerf wild-gaussians gs-w deraings deraings-plus
SCENES   ?= $(SCENE)
BIN      := $(VENV)/bin
KERNEL_TESTS := $(addprefix tests/baselines/splatting/test_,rasterizer.py hard_cases.py photometric.py)
READY    := $(VENV)/.ready
DOCS     := $(VENV)/.ready-docs
comma    := ,
names    := $(subst $(comma), ,$(PATTERNS))
patterns := $(if $(strip $(names)),--patterns $(names))
overwrite := $(if $(OVERWRITE),--overwrite)
sweep     = trap 'exit 130' INT TERM; bad=; \
            for seed in $(SEEDS); do for scene in $(SCENES); do for method in $(1); do \
            $(MAKE) eval METHOD=$$method SCENE="$$scene" SEED=$$seed || bad="$$bad $$method,$$scene,$$seed"; \
            done; done; done; test -z "$$bad" || { echo "not finished:$$bad" >&2; exit 1; }
enhance   = $(BIN)/python -m deraings.enhancement train --photographs '$(PHOTOGRAPHS)' \
            --cache '$(RESULTS)/enhancement/rain'
what     := $(if $(SUITE),--suite '$(SUITE)',--scene '$(SCENE)')

ifneq ($(strip $(CAPTURES)),)
export HYDROVIEWS_CAPTURES := $(CAPTURES)
endif

ifneq ($(and $(strip $(SUITE)),$(filter eval,$(MAKECMDGOALS))),)
$(error SUITE=$(SUITE): make eval takes one SCENE= at a time; SUITE= is for make dataset)
endif

ifneq ($(filter view film,$(MAKECMDGOALS)),)
ifeq ($(strip $(RUN)),)
$(error RUN= is missing: name the folder of a finished run, such as RUN=$(RESULTS)/demo/3dgs/courtyard/raindrop-1/seed-0)
endif
endif

.PHONY: setup dataset eval compare check severity enhancer drop-finder ablation leaderboard view film bench docs test fuzz test-simd lint

setup: $(READY)  ## everything into .venv, at the versions of constraints.txt

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --upgrade --constraint constraints.txt pip setuptools
	$(BIN)/python -m pip install --constraint constraints.txt $(PIP_ARGS) --editable '.[$(EXTRAS)]'
	touch $(READY)

dataset: $(READY)  ## a capture, its clean views, cameras and rainy variants; with SUITE= all of a suite's
	$(BIN)/python -m hydroviews build $(what) --profile $(PROFILE) --out '$(DATA)/$(PROFILE)' --seed $(SEED) $(patterns) $(overwrite)

eval: $(READY)  ## build what is missing, run the method and the reference rows, print the table
	$(BIN)/python -m leaderboard evaluate --method '$(METHOD)' --scene '$(SCENE)' --profile $(PROFILE) --seed $(SEED) --track $(TRACK) --data '$(DATA)' --results '$(RESULTS)' $(patterns) $(overwrite)

check: $(READY)  ## whether METHOD= keeps the contract of a method, on a room that is learned in seconds
	$(BIN)/python -m leaderboard check '$(METHOD)' --profile $(PROFILE)

severity: $(READY)  ## what plain 3DGS loses to each of a scene's six patterns, entered into its data card
	$(MAKE) eval METHOD=3dgs PATTERNS=raindrop-0,raindrop-1,raindrop-2,streak-0,streak-1,streak-2
	$(BIN)/python -m leaderboard card '$(DATA)/$(PROFILE)' --results '$(RESULTS)'

enhancer: $(READY)  ## train the enhancement network: PHOTOGRAPHS=a folder of clean photographs
	$(enhance) --out '$(RESULTS)/enhancement/first'
	$(enhance) --out '$(RESULTS)/enhancement/second' --start '$(RESULTS)/enhancement/first/weights.safetensors' \
		--seed 1 --steps 8000
	$(enhance) --out '$(RESULTS)/enhancement/small' --start '$(RESULTS)/enhancement/second/weights.safetensors' \
		--seed 2 --steps 6000 --sides 480 384 288 --lenses 20

drop-finder: $(READY)  ## train the network that finds drops for derain-nerf: PHOTOGRAPHS=a folder of clean photographs
	$(BIN)/python -m baselines.derain_nerf.raindrop_attention train --photographs '$(PHOTOGRAPHS)' --cache '$(RESULTS)/enhancement/rain' --out '$(RESULTS)/raindrop-attention/small'

compare: $(READY)  ## METHODS="..." or all of them, on SCENES="..." or SCENE=, for every seed of SEEDS="0 1 2"
	+$(call sweep,$(METHODS))

ablation: $(READY)  ## the same for DeRainGS with parts left out and with the rain model
	+$(call sweep,$(ABLATION))

leaderboard: $(READY)  ## gather all records into results/leaderboard.csv and tables.md
	$(BIN)/python -m leaderboard table --results '$(RESULTS)'

view: $(READY)  ## a trained scene in a browser: RUN=results/... [PORT=8080]
	$(BIN)/python -m leaderboard view '$(RUN)' --data '$(DATA)' --port $(PORT)

film: $(READY)  ## a film of a trained scene: RUN=results/... [OUT=film.mp4] [FILM_ARGS="--seconds 8 --fps 30 --size 800"]
	$(BIN)/python -m leaderboard film '$(RUN)' --data '$(DATA)' --out '$(OUT)' $(FILM_ARGS)

bench: $(READY)  ## speed against error: BENCH=splatting, quality, volumetric, enhancement, masking, methods, hard_rain, raindrops, streaks or dataset
	$(BIN)/python -m benchmarks.$(BENCH) $(BENCH_ARGS)

$(DOCS): $(READY)
	$(BIN)/python -m pip install --constraint constraints.txt --editable '.[docs]'
	touch $(DOCS)

docs: $(DOCS)  ## the site into build/site: open build/site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

# A file's tests share what they build, so they stay in one process.
test: $(READY)  ## all tests, shared out to up to four processes
	$(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile

fuzz: $(READY)  ## damaged captures and pictures, other ones than in the tests: EXAMPLES=1000 a reader
	FUZZ_EXAMPLES=$(EXAMPLES) $(BIN)/python -m pytest tests/hydroviews/formats/test_fuzzed_readers.py

test-simd: $(READY)  ## the kernels' tests with all instructions that the processor has
	for simd in $$($(BIN)/python -c "from baselines.splatting.kernels.simd import available; print(*available())"); do \
	  HYDROVIEWS_SIMD=$$simd $(BIN)/python -m pytest -q -n auto --maxprocesses 4 $(KERNEL_TESTS) || exit 1; done

lint: $(READY)  ## ruff and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
