"""Parts of the site that are generated: commands, make targets, settings, board numbers, pages of the API, formulas.

A page requests a generated part by a line of its own, such as `<!-- generated: commands -->` or, with an argument,
`<!-- generated: card gs-w -->`. Formulas between dollar signs become MathML, which browsers typeset without a network.
"""

import contextlib
import dataclasses
import html
import importlib
import inspect
import io
import re
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
import tyro

from hydroviews.cli.commands import imported
from hydroviews.dataset.suites import DEVELOPMENT, suite_of
from leaderboard.gather import BOARD, collect
from leaderboard.records import FLOOR
from leaderboard.site.contents import method_page

if TYPE_CHECKING:  # tests read this file where mkdocs is not installed
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
PACKAGES = ("hydroviews", "deraings", "baselines", "leaderboard")
PROGRAMS = (
    "hydroviews",
    "leaderboard",
    "deraings.enhancement",
    "baselines.derain_nerf.raindrop_attention",
)
LESS_SOUGHT = "---\nsearch:\n  boost: 0.3\n---\n"  # a search finds what people wrote for readers first
BOARD_SITE = "board/site"  # in the site, as `make docs` writes it
NOTEBOOK = "experiments/"  # pages that neither the navigation nor a search shows
# Medium patterns; all methods were run behind windows, some in drops and streaks.
CARD_PATTERNS = {"window-1": "window", "raindrop-1": "drops", "streak-1": "streaks"}
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
REQUEST = re.compile(r"<!-- generated: (\w+)((?: \S+)*) -->")
PROFILES = ("demo", "standard", "paper")
ATTRIBUTE = re.compile(r"^ {8}(\w+): (.+(?:\n {12,}.+)*)", re.MULTILINE)  # of a class, with the lines that go on


def commands() -> dict[str, Callable[..., None]]:
    """The function behind every subcommand, by its line: `hydroviews build`, `python -m package.module name`."""
    found: dict[str, Callable[..., None]] = {}
    for program in PROGRAMS:
        module = importlib.import_module(f"{program}.__main__")
        run, taken = module.run_command, []
        module.run_command = lambda mapping, *_, **__: taken.append(mapping)  # noqa: B023
        try:
            module.main()
        finally:
            module.run_command = run
        start = f"python -m {program}" if "." in program else program
        found |= {f"{start} {name}": imported(command) for name, command in taken[0].items()}
    return found


def command_help(line: str, function: Callable[..., None]) -> str:
    """What `--help` prints for a subcommand, as plain text."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.suppress(SystemExit):
        tyro.cli(function, prog=line, args=["--help"])
    return re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue()).strip()


def commands_section() -> str:
    """A section for every subcommand."""
    return "\n\n".join(
        f"### {line.removeprefix('python -m ')}\n\n```text\n{command_help(line, function)}\n```"
        for line, function in commands().items()
    )


def make_targets() -> dict[str, str]:
    """What the Makefile says of each of its targets."""
    return dict(re.findall(r"^([a-z-]+):[^\n#]*## (.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE))


def make_section() -> str:
    """A table of the targets."""
    rows = [f"| `make {name}` | {text.replace('[', chr(92) + '[')} |" for name, text in make_targets().items()]
    return "\n".join(["| target | does |", "|---|---|", *rows])


def comments(cls: type) -> dict[str, str]:
    """What is said of each field of a dataclass: under `Attributes` in its docstring, or in the comment beside it."""
    listed = (cls.__doc__ or "").partition("Attributes:\n")[2]
    said = {name: " ".join(text.split()) for name, text in ATTRIBUTE.findall(listed)}
    return said | dict(re.findall(r"^\s+(\w+): [^\n]*?  # (.*)$", inspect.getsource(cls), re.MULTILINE))


def fields(value: object, prefix: str = "") -> Iterator[tuple[str, object, str]]:
    """Name, value and meaning of every setting in a tree of dataclasses."""
    notes = {name: text for cls in reversed(type(value).__mro__[:-1]) for name, text in comments(cls).items()}
    for field in dataclasses.fields(value):  # type: ignore[arg-type]
        inner = getattr(value, field.name)
        if dataclasses.is_dataclass(inner):
            yield from fields(inner, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name, inner, notes.get(field.name, "")


def settings_section() -> str:
    """A table for every method: its settings in each profile."""
    methods = entry_points(group="hydroviews.methods")
    return "\n\n".join(f"### {entry.name}\n\n{settings_table(entry.load())}" for entry in sorted(methods))


def settings_table(method: type) -> str:
    """The settings of one method, a row each."""
    columns = {profile: list(fields(method.configuration(profile))) for profile in PROFILES}  # type: ignore[attr-defined]
    values = {profile: {name: value for name, value, _ in rows} for profile, rows in columns.items()}
    notes = {name: text for rows in columns.values() for name, _, text in rows}
    lines = [f"| setting | {' | '.join(PROFILES)} | meaning |", "|---|" + "---|" * (len(PROFILES) + 1)]
    for name, text in notes.items():
        cells = [f"`{values[profile][name]}`" if name in values[profile] else "" for profile in PROFILES]
        lines.append(f"| `{name}` | {' | '.join(cells)} | {text.replace('|', chr(92) + '|')} |")
    return "\n".join(lines)


def api_pages() -> dict[str, str]:
    """The pages of the API: one a package, with every public module directly in it."""
    pages = {}
    for top in PACKAGES:
        for init in sorted((ROOT / top).rglob("__init__.py")):
            package = ".".join(init.parent.relative_to(ROOT).parts)
            modules = [f"{package}.{path.stem}" for path in sorted(init.parent.glob("[a-z]*.py"))]
            listed = "\n\n".join(f"::: {name}" for name in [package, *modules])
            pages[package] = f"{LESS_SOUGHT}# {package}\n\n{listed}\n"
    return pages


@cache
def published_runs() -> pd.DataFrame:
    """The board's runs of the first seed, under the patterns of the cards."""
    table = collect(BOARD)
    own = table[(table.profile == "demo") & (table.seed == 0) & table.pattern.isin([*CARD_PATTERNS])]
    return own.assign(seconds=own[["train_s", "before_s", "after_s"]].sum(axis=1))


def card(method: str) -> str:
    """A table of a method's published scores: a row a scene, PSNR and the difference to the floor under its patterns.

    Below the table stands a link to the method's page of the board, which `make docs` writes beside the site.

    Raises:
        ValueError: the board has no run of the method.
    """
    runs = published_runs()
    own, floor = (runs[runs.method == name].set_index(["scene", "pattern"]) for name in (method, FLOOR))
    if own.empty:
        raise ValueError(f"a card of {method}: the board has no run of it")
    patterns = [pattern for pattern in CARD_PATTERNS if pattern in own.index.get_level_values("pattern")]
    heads = [f"{CARD_PATTERNS[pattern]} (`{pattern}`)" for pattern in patterns]
    lines = [f"| `{method}` | {' | '.join(heads)} | seconds |", "|---" * (len(heads) + 2) + "|"]
    for scene in sorted(
        set(own.index.get_level_values("scene")), key=lambda name: (suite_of(name) == DEVELOPMENT, name)
    ):
        title = f"{scene} (development)" if suite_of(scene) == DEVELOPMENT else scene
        cells = [score_cell(own.psnr, floor.psnr, (scene, pattern), method) for pattern in patterns]
        lines.append(f"| {title} | {' | '.join(cells)} | {own.seconds[scene].mean():.0f} |")
    return "\n".join(
        [*lines, "", f'<p><a href="../{BOARD_SITE}/methods/{method_page(method)}">All scores on the board</a></p>']
    )


def score_cell(own: pd.Series, floor: pd.Series, run: tuple[str, str], method: str) -> str:
    """PSNR of a run and, for other methods than the floor, the difference to the floor; empty without a run."""
    if run not in own:
        return ""
    return f"{own[run]:.2f}" + ("" if method == FLOOR else f" ({own[run] - floor[run]:+.2f})")


GENERATED = {"commands": commands_section, "make": make_section, "settings": settings_section, "card": card}


def listed() -> dict[str, list]:
    """Generated pages by the title in the navigation that they stand below."""
    tree: dict[str, list] = {top: [] for top in PACKAGES}
    for package in api_pages():
        top, _, inner = package.partition(".")
        tree[top].append({inner or top: f"reference/api/{package}.md"})
    return {"API": [{top: below} for top, below in tree.items()]}


def on_config(config: "MkDocsConfig") -> "MkDocsConfig":
    """Add the pages of the API to the navigation."""
    for title, pages in listed().items():
        fill(config.nav, title, pages)
    return config


def fill(nav: list, title: str, entries: list) -> None:
    """Put entries below the title, wherever in the navigation it stands."""
    for entry in nav:
        for name, below in entry.items() if isinstance(entry, dict) else ():
            if name == title:
                entry[name] = entries
            elif isinstance(below, list):
                fill(below, title, entries)


def on_files(files: "Files", config: "MkDocsConfig") -> "Files":
    """Add the pages of the API to the files."""
    from mkdocs.structure.files import File

    for package, text in api_pages().items():
        files.append(File.generated(config, f"reference/api/{package}.md", content=text))
    return files


def on_page_markdown(markdown: str, page: "Page", **_: object) -> str:
    """Write the generated parts of a page into it; keep the notebook out of searches."""
    if page.file.src_uri.startswith(NOTEBOOK):
        page.meta["search"] = {"exclude": True}
    return REQUEST.sub(lambda match: GENERATED[match[1]](*match[2].split()), markdown)


def on_page_content(page_html: str, **_: object) -> str:
    """Write formulas as MathML."""
    return typeset(page_html)


def on_post_page(output: str, **_: object) -> str:
    """Name the search for programs that read pages aloud: the theme leaves its dialog without a name."""
    return output.replace(
        'data-md-component="search" role="dialog"', 'data-md-component="search" role="dialog" aria-label="Search"'
    )


def typeset(text: str) -> str:
    """HTML with the formulas of `pymdownx.arithmatex` as MathML."""
    from latex2mathml.converter import convert

    def formula(match: re.Match) -> str:
        display = "block" if match[2] == "[" else "inline"
        written = convert(html.unescape(match[3]), display=display)
        return written.replace("<math ", '<math tabindex="0" ', 1) if display == "block" else written

    return FORMULA.sub(formula, text)
