"""The commands people and scripts rely on: programs take what make runs, and refuse bad input plainly."""

import ast
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import command
from parsing import documented_commands, refusal

from hydroviews.rain.registry import pattern_names

REPOSITORY = Path(__file__).parents[1]
MAKEFILE = (REPOSITORY / "Makefile").read_text()
TARGETS = re.search(r"^\.PHONY: (setup .*)$", MAKEFILE, re.MULTILINE)[1].split()
NEEDED = ("RUN=a run", "PHOTOGRAPHS=some pictures")
STRANGE = """it's *; touch evil # $(shell touch evil) `touch evil` $HOME $$ \\ "q" a,b & 'x' """


def make(*arguments: str) -> str:
    """What make would run."""
    line = ["make", "--dry-run", "--no-print-directory", f"VENV={sys.prefix}", *arguments]
    return subprocess.run(line, cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout


def started(lines: str) -> list[list[str]]:
    """The Python modules and their arguments in what make would run."""
    joined = lines.replace("\\\n", " ")
    found = re.findall(r"/python -m ((?:hydroviews|leaderboard|deraings|baselines)\b[^|;&\n]*)", joined)
    return [shlex.split(line) for line in found]


@pytest.mark.parametrize("target", TARGETS)
def test_what_make_runs_is_taken_by_the_programs(target):
    for module, *arguments in started(make(target, *NEEDED)):
        known = documented_commands()
        start = f"python -m {module}" if "." in module else module
        problem = refusal(known[f"{start} {arguments[0]}"], arguments[1:])
        assert not problem, f"{module} {arguments}\n{problem}"


@pytest.mark.parametrize(
    ("target", "settings", "expected"),
    [
        ("eval", ["METHOD=a.b:C", "SEED=7"], ["eval", "a.b:C", "--seed", "7"]),
        ("eval", ["PATTERNS=raindrop-0,streak-2"], ["--patterns", "raindrop-0", "streak-2"]),
        ("eval", ["OVERWRITE=1"], ["--overwrite"]),
        ("dataset", ["SUITE=paper", "SCENE=ignored"], ["build", "--suite", "paper"]),
        ("dataset", ["REPAIR=1"], ["--repair"]),
        ("dataset", ["RENDER=1"], ["--render"]),
        ("severity", [], ["--patterns", *pattern_names()]),
        ("severity", [], ["table", "--cards", "data/demo"]),
        ("ablation", [], ["eval", "deraings.method:RainModelOnly"]),
        ("leaderboard", [], ["site"]),
        ("enhancer", [], ["--start", "results/enhancement/second/weights.safetensors"]),
    ],
)
def test_settings_are_passed_on(target, settings, expected):
    words = [word for call in started(make(target, *NEEDED, *settings)) for word in call]
    assert set(expected) <= set(words)
    assert "ignored" not in words
    assert ("--overwrite" in words) == ("OVERWRITE=1" in settings)


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


def test_an_environment_is_set_up_anew_with_other_settings(recorded):
    said = recorded("--no-silent", "--just-print", "setup", "PYTHON=python3.13", "EXTRAS=dev").stdout
    assert "python3.13 -m venv --clear" in said
    assert "--editable '.[dev]'" in said
    assert "Nothing to be done" in recorded("--no-silent", "--just-print", "setup").stdout


@pytest.mark.parametrize(
    ("target", "name"), [("eval", "SCENE"), ("dataset", "SUITE"), ("view", "RUN"), ("film", "OUT"), ("bench", "BENCH")]
)
def test_no_shell_runs_what_is_in_a_setting(recorded, tmp_path, target, name):
    done = recorded(target, *(f"{other}=here" for other in ("RUN",) if other != name), f"{name}={STRANGE}")
    assert done.returncode == 0, done.stderr
    assert STRANGE in ast.literal_eval(done.stdout.splitlines()[0])
    assert not list(tmp_path.glob("*evil*"))


@pytest.mark.parametrize("target", ["eval", "dataset", "check", "severity", "compare", "ablation", "view", "enhancer"])
def test_what_fails_fails_make(recorded, target):
    bad = ("METHOD", "SCENE", "RUN", "PHOTOGRAPHS")
    assert recorded(target, *[f"{name}=bad" for name in bad], "PATTERNS=raindrop-0;true").returncode != 0


@pytest.mark.parametrize(
    ("arguments", "setting"),
    [
        (("dataset", "DATA="), "DATA"),  # which would be the root of the disk
        (("eval", "SCENE=a\ntouch evil"), "SCENE"),
        (("eval", "OVERWRITE=no"), "OVERWRITE"),
        (("dataset", "RENDER=yes"), "RENDER"),
        (("eval", "SUITE=paper"), "SUITE"),
        (("enhancer",), "PHOTOGRAPHS"),
        (("film",), "RUN"),
    ],
)
def test_settings_that_cannot_be_are_refused_by_make(recorded, arguments, setting):
    done = recorded(*arguments)
    assert done.returncode != 0
    assert f"{setting}=" in done.stderr
    assert not done.stdout


def test_compare_runs_every_method_on_every_scene_with_every_seed_and_goes_on_after_a_failure(recorded):
    done = recorded("compare", "METHODS=bad good", "SCENES=courtyard room", "SEEDS=0 1")
    calls = [ast.literal_eval(line) for line in done.stdout.splitlines()]
    asked = [tuple(call[call.index(name) + 1] for name in ("eval", "--scene", "--seed")) for call in calls]
    expected = [(method, scene, seed) for seed in "01" for scene in ("courtyard", "room") for method in ("bad", "good")]
    assert asked == expected
    assert done.returncode != 0
    assert "bad,courtyard,0" in done.stderr


def test_lists_name_what_there_is():
    methods = command("leaderboard", "methods").stdout.splitlines()
    assert {"3dgs", "deraings-plus", "NAME+enhance"} <= {line.split()[0] for line in methods}
    scenes = command("hydroviews", "download", "--captures", "/nowhere").stdout.splitlines()
    assert {"courtyard", "mipnerf360/garden"} <= {line.split()[0] for line in scenes}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("hydroviews", "eval", "nerf-x"), "METHOD=nerf-x"),
        (("hydroviews", "eval", "3dgs", "--profile", "huge"), "PROFILE=huge"),
        (("hydroviews", "eval", "3dgs", "--patterns", "raindrup-1"), "raindrop-1"),
        (("leaderboard", "check", "3dgs+fly"), "METHOD=3dgs+fly"),
        (("leaderboard", "table", "--results", "/nowhere"), "no finished run"),
        (("hydroviews", "verify", "/nowhere"), "no manifest.json"),
        (("hydroviews", "build", "/nowhere", "--out", "/nowhere"), "SCENE=/nowhere"),
        (("hydroviews", "poses", "/nowhere"), "0 photographs"),
        (("hydroviews", "build", "--suite", "/nowhere"), "SUITE=/nowhere"),
        (("hydroviews", "build", "360_v2/garden", "--captures", "/nowhere"), "download mipnerf360/garden"),
        (("hydroviews", "download", "moon"), "moon"),
        (("hydroviews", "download", "moon.zip"), "add --out data/fetched"),
        (("hydroviews", "reconstruct", "/nowhere"), "/nowhere"),
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
    ("program", "most", "told"),
    [
        ("hydroviews", 10, ("To do the three jobs: build, reconstruct, eval.", "doctor")),
        ("leaderboard", 14, ("To run: ", "To look: ", "To publish: ")),
    ],
)
def test_a_program_has_as_many_commands_as_one_look_takes(program, most, told):
    lines = [line.split()[1] for line in documented_commands() if line.startswith(f"{program} ")]
    assert len(lines) <= most
    assert program != "hydroviews" or lines[:3] == ["build", "reconstruct", "eval"]
    text = command(program, "--help").stdout
    assert [words for words in told if words not in text] == []


def test_a_command_imports_no_other_commands_modules():
    code = "import sys; from hydroviews.__main__ import main; sys.argv = ['hydroviews', 'verify', '/nowhere']"
    code += "\ntry:\n main()\nexcept SystemExit: print(*sorted({'leaderboard', 'deraings'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.split() == [], done.stderr
    assert "no manifest.json" in done.stderr
