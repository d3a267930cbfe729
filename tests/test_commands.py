"""The commands people and scripts rely on: make targets, their settings, exit codes."""

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import command

from hydroviews.rain.registry import pattern_names

REPOSITORY = Path(__file__).parents[1]


def make(*arguments: str) -> str:
    """What make would run."""
    line = ["make", "--dry-run", "--no-print-directory", f"VENV={sys.prefix}", *arguments]
    return subprocess.run(line, cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout


def test_make_eval_passes_every_setting_on():
    line = make("eval", "METHOD=a.b:C", "SCENE=my capture", "PROFILE=quick", "SEED=7", "PATTERNS=raindrop-0,streak-2")
    assert "-m leaderboard evaluate" in line
    assert "--method 'a.b:C'" in line
    assert "--scene 'my capture'" in line
    assert "--profile 'quick'" in line
    assert "--seed '7'" in line
    assert "--patterns 'raindrop-0' 'streak-2'" in line
    assert "--overwrite" not in line + make("eval", "OVERWRITE=0")
    assert "--overwrite" in make("eval", "OVERWRITE=1")
    assert "--repair" in make("dataset", "REPAIR=1")


def test_make_dataset_builds_a_scene_or_a_suite():
    assert "build --scene 'courtyard' --profile 'demo'" in make("dataset")
    line = make("dataset", "SUITE=paper", "PROFILE=quick", "SCENE=ignored")
    assert "build --suite 'paper' --profile 'quick'" in line
    assert "ignored" not in line


def test_make_view_and_film_pass_the_run_on():
    line = make("view", "RUN=a b", "PORT=9")
    assert "leaderboard view 'a b'" in line
    assert "--port '9'" in line
    assert "leaderboard film 'a b'" in make("film", "RUN=a b")


def test_make_eval_refuses_a_suite():
    with pytest.raises(subprocess.CalledProcessError) as refusal:
        make("eval", "SUITE=paper")
    assert "SUITE=paper: make eval takes one SCENE=" in refusal.value.stderr


def test_make_hands_the_folder_of_captures_on():
    assert "HYDROVIEWS_CAPTURES := /my captures" in make("--print-data-base", "dataset", "CAPTURES=/my captures")
    assert "HYDROVIEWS_CAPTURES :=" not in make("--print-data-base", "dataset")


STRANGE = """it's *; touch evil # $(shell touch evil) `touch evil` $HOME $$ \\ "q" a,b & 'x' """


@pytest.fixture
def recorded(tmp_path):
    """Runs make with a Python that only writes down its arguments, and fails where one of them is `bad`."""
    python = tmp_path / "python"
    python.write_text(f"#!{sys.executable}\nimport sys\nprint(sys.argv[1:])\nsys.exit('bad' in sys.argv)\n")
    python.chmod(0o755)
    shutil.copy(REPOSITORY / "Makefile", tmp_path)
    for name in ("pyproject.toml", "constraints.txt", "ready"):
        (tmp_path / name).touch()

    def run(*arguments):
        line = ["make", "--silent", f"BIN={tmp_path}", "READY=ready", *arguments]
        return subprocess.run(line, cwd=tmp_path, capture_output=True, text=True)

    return run


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ([], "Nothing to be done"),
        (["EXTRAS=dev"], "--editable '.[dev]'"),
        (["PIP_ARGS=--quiet"], "'--quiet' --editable"),
        (["PYTHON=python3.13"], "python3.13 -m venv --clear"),
    ],
)
def test_an_environment_is_set_up_anew_with_other_settings(recorded, settings, expected):
    said = recorded("--no-silent", "--just-print", "setup", *settings)
    assert expected in said.stdout
    assert "venv" not in recorded("--no-silent", "--just-print", "eval", *settings).stdout


@pytest.mark.parametrize(
    ("target", "name", "expected"),
    [
        ("dataset", "SCENE", {"--scene": STRANGE}),
        ("dataset", "SUITE", {"--suite": STRANGE}),
        ("dataset", "DATA", {"--out": f"{STRANGE}/demo"}),
        *[
            ("eval", name, {f"--{name.lower()}": STRANGE})
            for name in ("METHOD", "SCENE", "PROFILE", "SEED", "TRACK", "DATA", "RESULTS")
        ],
        ("eval", "PATTERNS", {"--patterns": STRANGE.replace(",", " ").split()}),
        ("compare", "SCENE", {"--scene": STRANGE}),
        ("compare", "SCENES", {"--scene": STRANGE.split()}),
        ("compare", "METHODS", {"--method": STRANGE.split()}),
        ("compare", "SEEDS", {"--seed": STRANGE.split()}),
        ("ablation", "DATA", {"--data": STRANGE}),
        ("check", "METHOD", {"check": STRANGE}),
        ("severity", "RESULTS", {"--results": STRANGE}),
        ("enhancer", "PHOTOGRAPHS", {"--photographs": STRANGE}),
        ("enhancer", "RESULTS", {"--cache": f"{STRANGE}/enhancement/rain"}),
        ("drop-finder", "PHOTOGRAPHS", {"--photographs": STRANGE}),
        ("leaderboard", "RESULTS", {"--results": STRANGE}),
        ("view", "RUN", {"view": STRANGE}),
        ("view", "PORT", {"--port": STRANGE}),
        ("film", "OUT", {"--out": STRANGE}),
        ("film", "FILM_ARGS", {"film.mp4": STRANGE.split()}),
        ("bench", "BENCH", {"benchmarks": STRANGE}),
        ("bench", "BENCH_ARGS", {"splatting": STRANGE.split()}),
    ],
)
def test_settings_reach_python_as_they_are(recorded, tmp_path, target, name, expected):
    """No shell runs what is in them, and make expands nothing."""
    needed = [f"{other}=here" for other in ("RUN", "PHOTOGRAPHS", "METHODS") if other != name]
    done = recorded(target, *needed, f"{name}={STRANGE}")
    assert done.returncode == 0, done.stderr
    (before, values), *_ = expected.items()
    calls = [ast.literal_eval(line) for line in done.stdout.splitlines()]
    if isinstance(values, str):
        assert all(call[call.index(before) + 1] == values for call in calls)
    elif target == "compare":  # a call for each, METHODS foremost
        assert set(values) == {call[call.index(before) + 1] for call in calls}
    else:
        assert all(call[call.index(before) + 1 :][: len(values)] == values for call in calls)
    assert not list(tmp_path.glob("*evil*"))


def test_captures_reach_python_as_they_are(tmp_path, recorded):
    (tmp_path / "python").write_text(f"#!{sys.executable}\nimport os\nprint(os.environ['HYDROVIEWS_CAPTURES'])\n")
    assert recorded("dataset", f"CAPTURES={STRANGE}").stdout == f"{STRANGE}\n"


@pytest.mark.parametrize("target", ["eval", "dataset", "check", "severity", "compare", "ablation", "view", "enhancer"])
def test_what_fails_fails_make(recorded, target):
    bad = ("METHOD", "SCENE", "RUN", "PHOTOGRAPHS")
    done = recorded(target, *[f"{name}=bad" for name in bad], "PATTERNS=raindrop-0;true")
    assert done.returncode != 0


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("dataset", "DATA="), "DATA= is empty"),  # which would be the root of the disk
        (("eval", "SCENE= "), "SCENE= is empty"),
        (("compare", "SEEDS="), "SEEDS= is empty"),
        (("eval", "SCENE=a\ntouch evil"), "SCENE= has a line break in it"),
        (("eval", "OVERWRITE=no"), "OVERWRITE=no: 1 to build"),
        (("dataset", "REPAIR=yes"), "REPAIR=yes: 1 to make"),
        (("enhancer",), "PHOTOGRAPHS= is missing"),
        (("film",), "RUN= is missing"),
    ],
)
def test_settings_that_cannot_be_are_refused_by_make(recorded, arguments, told):
    done = recorded(*arguments)
    assert done.returncode != 0
    assert told in done.stderr
    assert not done.stdout


def test_make_severity_takes_every_effect_unless_patterns_are_named():
    assert f"--patterns {' '.join(map(repr, pattern_names()))} \n" in make("severity")
    assert "--patterns 'raindrop-0' 'haze-1' \n" in make("severity", "PATTERNS=raindrop-0,haze-1")


TARGETS = {  # what each runs
    "setup": ("pip install --constraint constraints.txt  --editable '.[blender,viewer,compression,cuda,dev]'",),
    "dataset": ("-m hydroviews build --scene 'courtyard' --profile 'demo' --out 'data'/'demo' --seed '0'",),
    "eval": (
        "-m leaderboard evaluate --method '3dgs' --scene 'courtyard' --profile 'demo' --seed '0'",
        "--track 'given-poses'",
    ),
    "compare": (
        "-m leaderboard evaluate --method 'wild-gaussians'",
        "-m leaderboard evaluate --method 'deraings-plus'",
    ),
    "check": ("-m leaderboard check '3dgs' --profile 'demo'",),
    "severity": ("--method '3dgs' --scene 'courtyard'", "-m leaderboard card 'data'/'demo' --results 'results'"),
    "enhancer": ("-m deraings.enhancement train", "--start 'results'/enhancement/second/weights.safetensors"),
    "drop-finder": ("-m baselines.derain_nerf.raindrop_attention train",),
    "ablation": ("-m leaderboard evaluate --method 'deraings.method:RainModelOnly'",),
    "leaderboard": (
        "-m leaderboard table --results 'results'",
        "-m leaderboard site --results 'results' --data 'data'",
    ),
    "board": ("-m leaderboard board --pages README.md docs/topics/results-by-method.md", "topics/results-by-grade.md"),
    "view": ("-m leaderboard view 'a run' --data 'data' --port '8080'",),
    "film": ("-m leaderboard film 'a run' --data 'data' --out 'film.mp4'",),
    "bench": ("-m benchmarks 'splatting'",),
    "test": ("-m pytest -n auto",),
    "fuzz": ("FUZZ_EXAMPLES=1000 /nowhere/bin/python -m pytest tests/hydroviews/formats/test_fuzzed_readers.py",),
    "test-simd": ("HYDROVIEWS_SIMD=$simd", "test_rasterizer.py", "test_hard_cases.py", "test_photometric.py"),
    "lint": ("ruff check .", "ruff format --check .", "mypy"),
}


@pytest.mark.parametrize("target", TARGETS)
def test_make_targets(target):
    lines = make(target, "RUN=a run", "PHOTOGRAPHS=here", "VENV=/nowhere")
    assert "-m venv /nowhere" in lines  # what is not set up yet is
    assert all(call in lines for call in TARGETS[target])


def test_every_make_target_is_tested():
    listed = next(line for line in (REPOSITORY / "Makefile").read_text().splitlines() if line.startswith(".PHONY: "))
    assert set(listed.split()[1:]) <= set(TARGETS) | {"docs"}


@pytest.mark.parametrize("package", ["hydroviews", "leaderboard"])
def test_what_make_runs_is_a_command(package):
    lines = "".join(make(target, "RUN=a run", "PHOTOGRAPHS=here") for target in TARGETS if target != "setup")
    commands = set(re.findall(rf"-m {package} (\S+)", lines))
    assert commands
    text = command(package, "--help").stdout
    assert all(re.search(rf"\b{name}\b", text) for name in commands)


def test_lists_name_what_there_is():
    methods = command("leaderboard", "methods").stdout.splitlines()
    assert any(re.match(r"3dgs-budget +Plain 3DGS with half the Gaussians", line) for line in methods)
    assert any(line.startswith("NAME+enhance ") for line in methods)
    scenes = command("hydroviews", "scenes", "--captures", "/nowhere").stdout.splitlines()
    assert any(re.match(r"courtyard +modelled, rendered with Blender +comes with the package", line) for line in scenes)
    assert any(re.match(r"mipnerf360/garden .*to be downloaded, 12 GB", line) for line in scenes)


@pytest.mark.parametrize("asked", [("leaderboard", "evaluate"), ("leaderboard", "score"), ("hydroviews", "build")])
def test_choices_are_shown(asked):
    text = command(*asked, "--help").stdout
    assert "{demo,quick,paper}" in text
    assert ("{given-poses,sparse-views,rainy-poses}" in text) == (asked[0] == "leaderboard")
    assert ("{dark-0,dark-1," in text) == (asked[1] != "score")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("leaderboard", "evaluate", "--method", "nerf-x"), "METHOD=nerf-x: no such method"),
        (("leaderboard", "evaluate", "--method", "nerf-x"), "did you mean nerf-w?"),
        (("leaderboard", "evaluate", "--method", "3dgs", "--profile", "huge"), "PROFILE=huge"),
        (("leaderboard", "evaluate", "--method", "3dgs", "--patterns", "raindrup-1"), "did you mean raindrop-1?"),
        (("leaderboard", "check", "nerf-x"), "METHOD=nerf-x: no such method"),
        (("leaderboard", "check", "3dgs+fly"), "METHOD=3dgs+fly: no such wrapper"),
        (("leaderboard", "table", "--results", "/nowhere"), "no finished run"),
        (("hydroviews", "verify", "/nowhere"), "no manifest.json"),
        (("hydroviews", "build", "--scene", "/nowhere", "--out", "/nowhere"), "SCENE=/nowhere: no such folder"),
        (("hydroviews", "poses", "/nowhere"), "0 photographs"),
        (("hydroviews", "build", "--suite", "/nowhere"), "SUITE=/nowhere: no such suite"),
        (("hydroviews", "build", "--scene", "360_v2/garden", "--captures", "/nowhere"), "download mipnerf360/garden"),
        (("hydroviews", "download", "moon"), "moon: no such capture to download"),
        (("hydroviews", "download", "horse", "--captures", "/nowhere"), "has no horse"),
        (("leaderboard", "score", "--pattern", "raindrop-1", "--results", "/nowhere"), "no such run"),
        (("leaderboard", "film", "/nowhere/x"), "no such run"),
        (("leaderboard", "export", "/nowhere/x", "--out", "/nowhere/x.ply"), "no such run"),
    ],
)
def test_bad_input_ends_with_a_plain_error(arguments, message):
    result = command(*arguments)
    assert result.returncode == 2
    assert message in result.stderr
    assert not Path("/nowhere").exists()


@pytest.mark.parametrize(
    ("package", "commands"),
    [
        ("hydroviews", ("build", "verify", "poses", "download")),
        ("leaderboard", ("evaluate", "check", "table", "score", "overview", "view", "film", "export")),
    ],
)
def test_help_names_the_commands(package, commands):
    text = command(package, "--help").stdout
    assert all(name in text for name in commands)


@pytest.mark.parametrize("package", ["hydroviews", "leaderboard"])
def test_a_process_ends_with_a_plain_error_and_its_status(package):
    arguments = {"hydroviews": ("verify", "/nowhere"), "leaderboard": ("table", "--results", "/nowhere")}[package]
    run = [sys.executable, "-m", package, *arguments]
    done = subprocess.run(run, cwd=REPOSITORY, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("error: /nowhere")
    assert "Traceback" not in done.stderr


def test_nothing_but_blender_processes_imports_bpy():
    imports = "sys, hydroviews.__main__, leaderboard.__main__, baselines.gaussian_splatting"
    code = f"import {imports}; assert 'bpy' not in sys.modules"
    assert subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY).returncode == 0


def test_compare_runs_every_method_on_every_scene_with_every_seed():
    lines = make("compare", "METHODS=3dgs gs-w", "SCENES=courtyard room", "SEEDS=0 1").splitlines()
    runs = [line for line in lines if "leaderboard evaluate" in line]
    asked = [(method, scene, seed) for seed in "01" for scene in ("courtyard", "room") for method in ("3dgs", "gs-w")]
    assert len(runs) == len(asked)
    for line, (method, scene, seed) in zip(runs, asked, strict=True):
        assert f"--method '{method}' --scene '{scene}' --profile 'demo' --seed '{seed}' " in line


def test_compare_goes_on_after_a_run_that_failed(tmp_path):
    python = tmp_path / "python"  # that evaluates every method but `bad`
    python.write_text('#!/bin/sh\necho "$@" >> "$(dirname "$0")/asked"\ncase "$*" in *bad*) exit 1;; esac\n')
    python.chmod(0o755)
    ready = tmp_path / "ready"
    ready.touch()
    settings = ["METHODS=bad good", "SEEDS=0 1", f"BIN={tmp_path}", f"READY={ready}"]
    line = ["make", "--no-print-directory", *settings, "compare"]
    done = subprocess.run(line, cwd=REPOSITORY, capture_output=True, text=True)
    asked = [line.split("--method ")[1].split()[0] for line in (tmp_path / "asked").read_text().splitlines()]
    assert asked == ["bad", "good", "bad", "good"]
    assert done.returncode != 0
    assert "not finished: bad,courtyard,0 bad,courtyard,1\n" in done.stderr


def test_the_ablation_is_a_comparison_of_its_own_methods():
    runs = [line for line in make("ablation", "SCENE=street").splitlines() if "leaderboard evaluate" in line]
    assert len(runs) == 7
    assert all("--scene 'street'" in line for line in runs)
    assert "--method 'deraings.method:Masks'" in runs[0]
    assert "--method '3dgs+enhance'" in runs[1]
