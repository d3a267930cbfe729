"""The documentation: pages have their size, links lead somewhere, and what they tell people to type is what runs."""

import dataclasses
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from commands import command
from parsing import docs_hooks, refusal
from synthetic import capture_in

from hydroviews.formats.writers import write_colmap

REPOSITORY = Path(__file__).parents[1]
DOCS = REPOSITORY / "docs"
NOTEBOOK = DOCS / "experiments"
PAGES = sorted(path for path in DOCS.rglob("*.md") if NOTEBOOK not in path.parents)
READ = [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *PAGES]  # by people, as what is
FENCED = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`((?:hydroviews|baselines|deraings|leaderboard|tests|benchmarks|examples)/[\w/.-]+)`")
LINK = re.compile(r"\]\(([^)\s]+)\)")
CHEAP = ["python -m deraings.enhancement describe --network small"]  # seconds, and without data
MOST_WORDS, MOST_LINES = 800, 150


def name(path: Path) -> str:
    return str(path.relative_to(REPOSITORY))


def prose(page: Path) -> str:
    return FENCED.sub("", page.read_text())


def blocks(page: Path, language: str) -> list[str]:
    return [text for kind, text in FENCED.findall(page.read_text()) if kind == language]


def commands() -> Iterator[tuple[str, list[str]]]:
    """Every command in a block of bash, with the page it stands on."""
    for page in READ:
        for line in "".join(blocks(page, "bash")).splitlines():
            words = shlex.split(line, comments=True)
            if words:
                yield name(page), words


@pytest.fixture(scope="module")
def hooks():
    return docs_hooks()


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_page_can_be_read_in_one_go(page):
    words = len(prose(page).split())
    assert words <= MOST_WORDS, f"{words} words; what was tried belongs into docs/experiments"


def test_the_readme_is_one_look():
    lines = (REPOSITORY / "README.md").read_text().splitlines()
    assert len(lines) <= MOST_LINES
    assert any(line.startswith("![") for line in lines[:15]), "a picture above the fold"


@pytest.mark.parametrize("page", [*READ, *sorted(NOTEBOOK.glob("*.md"))], ids=name)
def test_links_and_pictures_are_there(page):
    targets = [target.partition("#")[0] for target in LINK.findall(prose(page)) if "://" not in target]
    missing = [target for target in targets if target and not (page.parent / target).exists()]
    assert not missing


@pytest.mark.parametrize("page", READ, ids=name)
def test_files_that_a_page_names_are_there(page):
    assert [path for path in CODE.findall(page.read_text()) if not (REPOSITORY / path).exists()] == []


def test_pages_that_the_code_names_are_there():
    folders = ("hydroviews", "baselines", "deraings", "leaderboard", "benchmarks", "tests")
    code = [path for folder in folders for path in (REPOSITORY / folder).rglob("*.py")]
    named = {(page, path.name) for path in code for page in re.findall(r"\bdocs/[\w/.-]+\.md", path.read_text())}
    assert len(named) > 3
    assert sorted((page, name) for page, name in named if not (REPOSITORY / page).is_file()) == []


def test_every_page_is_in_the_navigation(hooks):
    navigation = (REPOSITORY / "mkdocs.yml").read_text()
    for title, pages in hooks.listed().items():
        assert f"- {title}: []" in navigation
        assert pages
    filled = tuple(f"{folder}/" for folder in hooks.FOLDERS.values())
    pages = [str(page.relative_to(DOCS)) for page in PAGES]
    assert sorted(re.findall(r"[\w/-]+\.md", navigation)) == [page for page in pages if not page.startswith(filled)]


def test_notes_of_experiments_are_dated_and_listed():
    index = (NOTEBOOK / "index.md").read_text()
    for page in NOTEBOOK.glob("*.md"):
        if page.name != "index.md":
            assert re.match(r"20\d\d-\d\d-", page.name)
            assert f"({page.name})" in index


def test_commands_name_make_targets_and_settings_that_there_are():
    makefile = (REPOSITORY / "Makefile").read_text()
    targets = set(re.search(r"^\.PHONY: (.*)$", makefile, re.MULTILINE)[1].split())
    settings = set(re.findall(r"\$\((\w+)\)", makefile)) | set(re.findall(r"^(\w+)\s*\?=", makefile, re.MULTILINE))
    made = [(page, words[1:]) for page, words in commands() if words[0] == "make"]
    assert len(made) > 10
    for page, words in made:
        assert words[0] in targets, f"{page}: make {words[0]}"
        for word in words[1:]:
            assert word.partition("=")[0] in settings, f"{page}: make {' '.join(words)}"
        dry = ["make", "--dry-run", f"VENV={sys.prefix}", *words]
        subprocess.run(dry, cwd=REPOSITORY, stdout=subprocess.DEVNULL, check=True)


def test_the_reference_lists_every_setting_of_make():
    makefile = (REPOSITORY / "Makefile").read_text()
    settings = {"PYTHON", "VENV", *" ".join(re.findall(r"^(?:GIVEN|OPTIONAL) *:= (.*)$", makefile, re.M)).split()}
    assert len(settings) > 20
    text = (DOCS / "reference/commands.md").read_text()
    assert sorted(name for name in settings if f"`{name}=" not in text) == []


def test_commands_are_parsed_by_the_programs(hooks):
    known = hooks.commands()
    said = [(page, words) for page, words in commands() if words[0] == "python"]
    assert len(said) > 10
    for page, words in said:
        line = " ".join(words[:4])
        assert line in known, f"{page}: {line}"
        problem = refusal(known[line], words[4:])
        assert not problem, f"{page}: {' '.join(words)}\n{problem}"


@pytest.mark.parametrize("line", CHEAP)
def test_cheap_commands_run(line, monkeypatch):
    words = line.split()
    assert words in [words for _, words in commands()], "not in the documentation any more"
    monkeypatch.chdir(REPOSITORY)
    assert command(*words[2:]).returncode == 0


def test_an_option_that_there_is_not_would_be_noticed(hooks):
    sheet = hooks.commands()["python -m hydroviews sheet"]
    assert "--no-such-option" in refusal(sheet, ["data", "--no-such-option", "1"])
    assert refusal(sheet, ["data", "--views", "many"])


def test_blocks_hold_commands_alone():
    assert {words[0] for _, words in commands()} == {"make", "python"}


def test_the_reference_lists_every_command_and_target(hooks):
    text = hooks.commands_section()
    for line in hooks.commands():
        assert f"### {line.removeprefix('python -m ')}\n" in text
    assert "--every-view" in text
    makefile = (REPOSITORY / "Makefile").read_text()
    assert {"setup", "eval", "docs"} <= set(hooks.make_targets())
    for target in hooks.make_targets():
        assert f"\n{target}:" in makefile


def test_the_reference_lists_every_setting_of_a_method(hooks):
    from baselines.gaussian_splatting import GaussianSplatting

    table = hooks.settings_table(GaussianSplatting)
    row = next(line for line in table.splitlines() if line.startswith("| `iterations` |"))
    iterations = [GaussianSplatting.configuration(profile).iterations for profile in ("demo", "quick", "paper")]
    assert [cell.strip() for cell in row.split("|")[2:5]] == [f"`{number}`" for number in iterations]
    assert "| `strategy." in table


def test_the_reference_says_what_a_setting_means_wherever_its_class_says_it(hooks):
    from deraings.rain_model.mist_config import MistConfig
    from deraings.rain_model.model import RainConfig

    meanings = {name: meaning for name, _, meaning in hooks.fields(RainConfig())}
    assert meanings["mist.cells"] == "grid cells along the longer side, at least 1."
    assert meanings["mist.start"].endswith("from 0.03 on.")  # of two lines
    assert all(meanings.values())
    assert hooks.comments(MistConfig).keys() == {field.name for field in dataclasses.fields(MistConfig)}


@pytest.mark.parametrize("page", READ, ids=name)
def test_python_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for text in blocks(page, "python"):
        exec(compile(text, name(page), "exec"), {"__name__": "example"})


def test_the_quick_start_runs(tmp_path, monkeypatch):
    cells = json.loads((REPOSITORY / "examples/quick_start.ipynb").read_text())["cells"]
    capture = tmp_path / "capture"
    write_colmap(capture_in(capture), capture / "sparse/0")
    small = {"scene": str(capture), "patterns": ["streak-1"], "methods": ["3dgs"], "steps": 5, "folder": tmp_path}
    variables: dict = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "keep the notebook without outputs"
            exec(compile("".join(cell["source"]), "quick_start", "exec"), variables)
            if "parameters" in cell["metadata"].get("tags", ()):
                assert small.keys() <= variables.keys()
                variables |= small
    assert variables["scores"]["streak-1", "3dgs"] > 5
    assert variables["rows"][0].shape == (36, 3 * 48, 3)
