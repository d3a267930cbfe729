"""The documentation: links lead somewhere, commands and code on pages run, and generated parts match the program."""

import dataclasses
import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from commands import command
from parsing import docs_hooks, refusal
from synthetic import written_capture

from leaderboard.gather import BOARD, run_folders

REPOSITORY = Path(__file__).parents[1]
DOCS = REPOSITORY / "docs"
NOTEBOOK = DOCS / "experiments"
PAGES = sorted(path for path in DOCS.rglob("*.md") if NOTEBOOK not in path.parents)
READ = [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *PAGES]  # by people, as what is
FENCED = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`((?:hydroviews|baselines|deraings|leaderboard|tests|benchmarks|examples)/[\w/.-]+)`")
LINK = re.compile(r"\]\(([^)\s]+)\)")
CHEAP = "python -m deraings.enhancement describe --network small"  # seconds, and without data
OURS = ("hydroviews", "leaderboard", "python")
MOST_LINES = 120  # of the README
ELSEWHERE = {"git", "source", "cd", "pip", "export"}  # commands on pages that are not ours; shells parse them


def name(path: Path) -> str:
    return str(path.relative_to(REPOSITORY))


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


def test_the_readme_is_one_look():
    lines = (REPOSITORY / "README.md").read_text().splitlines()
    assert len(lines) <= MOST_LINES
    assert any(line.startswith("![") for line in lines[:15]), "a picture above the fold"


def test_the_readme_counts_methods_and_published_runs():
    text = (REPOSITORY / "README.md").read_text()
    assert int(re.search(r"\*\*(\d+) registered methods", text)[1]) == len(entry_points(group="hydroviews.methods"))
    assert int(re.search(r"of (\d+) published runs", text)[1]) == len(run_folders(BOARD))


@pytest.mark.parametrize("page", [*READ, *sorted(NOTEBOOK.glob("*.md"))], ids=name)
def test_what_a_page_links_to_shows_and_names_is_there(page):
    targets = [target.partition("#")[0] for target in LINK.findall(FENCED.sub("", page.read_text()))]
    assert [target for target in targets if ":" not in target and not (page.parent / target).exists()] == []
    named = CODE.findall(page.read_text()) if page in READ else []  # what the notebook names was there on its day
    assert [path for path in named if not (REPOSITORY / path).exists()] == []


def test_pages_that_the_code_names_are_there():
    folders = ("hydroviews", "baselines", "deraings", "leaderboard", "benchmarks", "tests")
    code = [path for folder in folders for path in (REPOSITORY / folder).rglob("*.py")]
    named = {(page, path.name) for path in code for page in re.findall(r"\bdocs/[\w/.-]+\.md", path.read_text())}
    assert len(named) > 3
    assert sorted((page, name) for page, name in named if not (REPOSITORY / page).is_file()) == []


def test_every_page_is_in_the_navigation_once_and_the_notebook_is_not():
    navigation = (REPOSITORY / "mkdocs.yml").read_text().partition("\nnav:")[2]
    assert "- API: []" in navigation
    assert sorted(re.findall(r"[\w/-]+\.md", navigation)) == [str(page.relative_to(DOCS)) for page in PAGES]


def test_generated_pages_of_the_navigation_are_there(hooks):
    pages = [page for top in hooks.listed()["API"] for below in top.values() for page in below]
    listed = [path for page in pages for path in page.values()]
    assert sorted(listed) == sorted(f"reference/api/{package}.md" for package in hooks.api_pages())


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
    said = [(page, words) for page, words in commands() if words[0] in OURS]
    assert len(said) > 10
    for page, words in said:
        length = 4 if words[0] == "python" else 2
        line = " ".join(words[:length])
        assert line in known, f"{page}: {line}"
        problem = refusal(known[line], words[length:])
        assert not problem, f"{page}: {' '.join(words)}\n{problem}"


def test_a_cheap_command_runs(monkeypatch):
    words = CHEAP.split()
    assert words in [words for _, words in commands()], "not in the documentation any more"
    monkeypatch.chdir(REPOSITORY)
    assert command(*words[2:]).returncode == 0


def test_blocks_hold_commands_that_are_parsed_here_or_known_and_a_shell_parses_them():
    found = {words[0] for _, words in commands()}
    assert {"make", *OURS} <= found <= {"make", *OURS, *ELSEWHERE}
    for page in READ:
        for text in blocks(page, "bash"):
            done = subprocess.run(["bash", "-n"], input=text, text=True, capture_output=True)
            assert (done.returncode, done.stderr) == (0, ""), f"{name(page)}: {text}"


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
    iterations = [GaussianSplatting.configuration(profile).iterations for profile in ("demo", "standard", "paper")]
    assert [cell.strip() for cell in row.split("|")[2:5]] == [f"`{number}`" for number in iterations]
    assert "| `strategy." in table


def test_the_reference_says_what_a_setting_means_wherever_its_class_says_it(hooks):
    from deraings.rain_model.config import MistConfig, RainConfig

    meanings = {name: meaning for name, _, meaning in hooks.fields(RainConfig())}
    assert meanings["drops.noise"].startswith("standard deviation of renders, encoded, positive")
    assert meanings["mist.slack"].endswith("that most is a quantile.")  # of two lines
    assert all(meanings.values())
    assert hooks.comments(MistConfig).keys() == {field.name for field in dataclasses.fields(MistConfig)}


def test_every_baseline_has_a_card_and_every_card_is_written(hooks):
    methods = DOCS / "methods"
    asked = [match for page in methods.glob("*.md") for match in hooks.REQUEST.findall(page.read_text())]
    carded = {argument.strip() for kind, argument in asked if kind == "card"}
    assert len(carded) > 10
    for method in carded:
        assert f"| `{method}` |" in hooks.card(method)
    cards = "".join((methods / page).read_text() for page in ("splatting.md", "radiance-fields.md"))
    ours = {"deraings", "deraings-plus"}  # have pages of their own
    names = {entry.name for entry in entry_points(group="hydroviews.methods")} - ours
    assert sorted(name for name in names if f"`{name}`" not in cards) == []
    assert sorted(names - carded) == ["3dgs-budget", "3dgs-budget-clean", "3dgs-clean"]  # not run, or a reference


def test_a_card_has_the_boards_scores_and_the_differences_to_the_floor(hooks):
    paths = [BOARD / f"demo/{name}/pond/streak-1/seed-0/record.json" for name in ("desplat", "3dgs")]
    own, floor = (json.loads(path.read_text())["psnr"] for path in paths)
    row = next(line for line in hooks.card("desplat").splitlines() if line.startswith("| pond |"))
    assert row.split(" | ")[3] == f"{own:.2f} ({own - floor:+.2f})"
    assert "streaks" not in hooks.card("gs-w")  # without a run
    row = next(line for line in hooks.card("3dgs").splitlines() if line.startswith("| courtyard (development) |"))
    assert not re.search(r"\([+-]", row)
    with pytest.raises(ValueError, match="no run of it"):
        hooks.card("3dgs-budget")


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_formulas_are_typeset(page, hooks):
    markdown = pytest.importorskip("markdown")
    pytest.importorskip("latex2mathml")
    pytest.importorskip("pymdownx")
    extensions = ["tables", "pymdownx.superfences", "pymdownx.arithmatex"]
    text = markdown.markdown(
        page.read_text(), extensions=extensions, extension_configs={"pymdownx.arithmatex": {"generic": True}}
    )
    typeset = hooks.typeset(text)
    assert "arithmatex" not in typeset
    assert typeset.count("<math") == text.count("arithmatex")


def test_formulas_become_mathml_that_needs_no_network(hooks):
    pytest.importorskip("latex2mathml")
    block = hooks.typeset(r'<div class="arithmatex">\[a &lt; \frac{1}{2}\]</div>')
    assert block.startswith("<math")
    assert 'display="block"' in block
    assert "<mfrac>" in block
    assert "&#x0003C;" in block or "&lt;" in block
    assert "http" not in block.replace("http://www.w3.org/1998/Math/MathML", "")
    assert hooks.typeset("<p>no formula, $5</p>") == "<p>no formula, $5</p>"


@pytest.mark.parametrize("page", READ, ids=name)
def test_python_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for text in blocks(page, "python"):
        exec(compile(text, name(page), "exec"), {"__name__": "example"})


def test_the_quick_start_runs(tmp_path, monkeypatch):
    cells = json.loads((REPOSITORY / "examples/quick_start.ipynb").read_text())["cells"]
    small = {"scene": str(written_capture(tmp_path / "capture")), "patterns": ["streak-1"], "methods": ["3dgs"]}
    small |= {"steps": 5, "folder": tmp_path}
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
