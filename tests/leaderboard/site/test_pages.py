"""The pages as HTML: whole, closed in themselves, true to the records, and deaf to what names try."""

import json
import logging
import re
import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np
import pandas as pd
import pytest
from damage import edit
from PIL import Image

from baselines.method import citation_of
from baselines.training.learning_curve import LEARNING_CURVE
from hydroviews.files.atomic import write_json
from hydroviews.metrics import find_metrics
from leaderboard.gather import PUBLICATION, collect
from leaderboard.publishing.board_pages import write_board
from leaderboard.publishing.publish import publish
from leaderboard.records import run_folder
from leaderboard.site.contents import method_page
from leaderboard.site.runs import page_name
from leaderboard.site.write import PLOTTED, write_site
from leaderboard.tables.dataframes import cost_means
from leaderboard.tables.markdown import COST_TITLES, cost_text
from leaderboard.tables.means import blocks, shown_names
from leaderboard.tables.rankings import RankedMethod, rankings

THEIRS = "<img src=x onerror=alert(1)>\"'& <\\script><script>alert(2)< (submitted)"
THEIRS_IN_RECORDS = THEIRS.removesuffix(" (submitted)")
SCENE_OF = {"test": "pond", "development": "mipnerf360_bonsai"}
VOID = {"meta", "link", "img", "input", "br", "line", "rect", "circle", "polyline"}


class Page(HTMLParser):
    """A page's elements, with whether each is closed in order, and the text of its tables."""

    def __init__(self, path: Path):
        super().__init__()
        self.elements: list[tuple[str, dict]] = []
        self.tables: list[list[list[tuple[str, dict]]]] = []  # by table and row: text and attributes of cells
        self.open: list[str] = []
        self.scripts: list[str] = []
        self.text = ""
        self.feed(path.read_text(encoding="utf-8"))
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        assert len(dict(attributes)) == len(attributes)
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th") and self.tables:
            self.tables[-1][-1].append(("", dict(attributes)))

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, text):
        self.text += text
        if self.open and self.open[-1] == "script":
            self.scripts.append(text)
        if self.tables and {"td", "th"} & set(self.open):
            before, attributes = self.tables[-1][-1][-1]
            self.tables[-1][-1][-1] = (before + text, attributes)

    def all(self, tag: str) -> list[dict]:
        return [attributes for name, attributes in self.elements if name == tag]


def papers_and_code(*methods: str) -> set[str]:
    """Addresses that methods cite."""
    return {address for one in map(citation_of, methods) for address in (one.link, one.code) if address}


def pages_of(results: Path) -> dict[Path, Page]:
    return {path: Page(path) for path in sorted((results / "site").rglob("*.html"))}


@pytest.fixture(scope="module")
def pages(written):
    return pages_of(written)


def one(pages: dict[Path, Page], name: str) -> Page:
    """The first page with such a name."""
    return next(page for path, page in pages.items() if re.search(name, str(path)))


def on_pond(results: Path, method: str, pattern: str = "streak-1") -> Path:
    return run_folder(results, "demo", method, "pond", pattern, 0, "given-poses")


@pytest.fixture
def copied(written, tmp_path):
    return Path(shutil.copytree(written, tmp_path / "results"))


@pytest.fixture
def rewritten(copied):
    """Writes the pages of the copied results again."""
    return lambda docs="": write_site(collect(copied), copied, copied / "no data", docs)


def test_there_is_a_page_per_method_scene_and_run(written, pages):
    table = collect(written)
    assert len(table) == 3 * 2 * 2 + 2 + 1
    assert len(pages) == 1 + 6 + 2 + len(table)
    assert {len(page.all("h1")) for page in pages.values()} == {1}


@pytest.mark.parametrize("board", ["written", "shipped"])
def test_links_and_pictures_resolve_and_nothing_is_outside(request, board):
    results = request.getfixturevalue(board)
    found = pages_of(results)
    theirs = {"https://example.org/a?b=1&c=2", *papers_and_code("3dgs", "3dgs-clean", "deraings", "nerf-w")}
    for path, page in found.items():
        for tag, attributes in page.elements:
            for name in {"href", "src"} & set(attributes):
                address = urlsplit(attributes[name])
                if address.scheme == "https":
                    assert (tag, attributes[name] in theirs) == ("a", True)
                elif attributes[name] != "data:,":
                    assert (address.scheme, address.netloc) == ("", "")
                    target = (path.parent / unquote(address.path)).resolve() if address.path else path
                    assert target.is_relative_to(results)
                    assert target.exists(), attributes[name]
                    if address.fragment:
                        assert [a.get("id") for _, a in found[target].elements].count(address.fragment) == 1
    for asset in ("style.css", "script.js"):
        assert "//" not in (results / "site" / asset).read_text().replace("// ", "")  # comments have a blank


def test_a_board_shows_the_renders_that_it_has_and_says_where_it_has_none(shipped):
    found = pages_of(shipped)
    assert len(found) == 1 + 6 + 2 + 15
    drawn, captured = (one(found, f"scenes/{name}") for name in ("pond", "mip"))
    assert [a for a in drawn.all("form") if "viewer" in a["class"]]
    assert not captured.all("img")
    assert "These runs have no pictures." in captured.text
    files = [a["href"].rpartition("/")[2] for a in one(found, "runs/.*bonsai").all("a")]
    assert files[-3:] == ["learning_curve.csv", "per_view.csv", "record.json"]


def test_a_board_without_renders_has_pages_that_say_so(written, tmp_path):
    publish(written, tmp_path / "board", submitted=True)
    for drawn in (tmp_path / "board").glob("demo/*/pond"):
        shutil.rmtree(drawn)
    write_board(tmp_path / "board", tmp_path / "shown")
    found = pages_of(tmp_path / "shown")
    for path, page in found.items():
        assert page.all("img") == []
        assert not [a for a in page.all("form") if "viewer" in a["class"]]
        assert ("These runs have no pictures." in page.text) == (path.parent.name == "scenes")
    assert "A page of tables each." in found[tmp_path / "shown" / "site" / "index.html"].text


def test_the_course_of_a_training_is_drawn(pages):
    page = one(pages, f"runs/{page_name('demo', '3dgs', 'pond', 'streak-1', '0', 'given-poses')}")
    names = [drawing["aria-label"].partition(":")[0] for drawing in page.all("svg")]
    assert names == ["loss over the seconds of training", "Gaussians over the seconds of training"]


def test_names_run_no_script(pages):
    for page in pages.values():
        assert {tag for tag, _ in page.elements} & {"b", "iframe", "object"} == set()
        assert not [name for _, attributes in page.elements for name in attributes if name.startswith("on")]
        assert not [a for _, a in page.elements if str(a.get("href", "")).startswith("javascript")]
        for attributes in page.all("script"):
            assert attributes.get("type") == "application/json" or attributes["src"].endswith("script.js")
        for text in page.scripts:
            assert "<" not in text
            json.loads(text)
        assert all(attributes["src"].endswith(".webp") for attributes in page.all("img") if "src" in attributes)
    text = "".join(page.text for page in pages.values())
    assert "onerror=alert(1)>" in text  # shown as it is
    assert "</td></script><script>alert(3)</script>" in text


def test_names_become_plain_file_names():
    names = [page_name("a:B", "x"), page_name("a.B", "x"), page_name("../../etc", "<>"), page_name("ü" * 300)]
    assert len(set(names)) == 4
    assert all(set(name) <= set("abcdefghijklmnopqrstuvwxyz0123456789-.") and len(name) < 100 for name in names)


def test_rows_are_the_records(written, pages):
    table = collect(written)
    page = pages[written / "site" / "index.html"]
    head, *rows = next(found for found in page.tables if len(found) == len(table) + 1)
    place = {text: i for i, (text, _) in enumerate(head)}
    for metric in find_metrics():
        shown = [float(row[place[metric.title]][1].get("data-value", "nan")) for row in rows]
        assert shown == pytest.approx(list(table[metric.name].astype(float)), nan_ok=True)
    assert [row[place["Scene"]][0] for row in rows] == list(table.scene)
    assert [row[place["Status"]][0] for row in rows] == list(table.status)
    assert {row[place["Suite"]][0] for row in rows} == {"test", "development"}


def tables_by_name(page: Page) -> dict[str, list[list[tuple[str, dict]]]]:
    """The tables of the index by what the region around each is called."""
    names = [a["aria-label"] for a in page.all("div") if a.get("role") == "region"]
    return dict(zip(names, page.tables, strict=True))


def runs_of_suite(table: pd.DataFrame, suite: str) -> pd.DataFrame:
    """The records of the one scene that the board has of a suite, methods named as on the pages."""
    return table[table.scene == SCENE_OF[suite]].assign(method=shown_names)


def shows(cell: tuple[str, dict], value: float | None, text: Callable[[float], str]) -> bool:
    """Whether a cell has a number to read and to sort by, or neither."""
    number = float(cell[1].get("data-value", "nan"))
    if value is None or np.isnan(value):
        return cell[0] == "" and np.isnan(number)
    return cell[0] == text(value) and number == pytest.approx(value)


def has_scores_and_gain(cells: dict[str, tuple[str, dict]], ranked: RankedMethod) -> bool:
    scores = [shows(cells[metric.title], ranked.scores[metric.name], metric.text) for metric in find_metrics()]
    return all(scores) and shows(cells["Gain over 3dgs"], ranked.gain, lambda gain: f"{gain:+.2f}")


@pytest.mark.parametrize("suite", SCENE_OF)
def test_there_is_a_table_per_rain_and_grade_with_every_method_that_has_runs(written, pages, suite):
    runs, metrics = runs_of_suite(collect(written), suite), find_metrics()
    tables = tables_by_name(pages[written / "site" / "index.html"])
    scene = one(pages, f"scenes/{SCENE_OF[suite].replace('_', '-')}")
    assert [found.title for found in rankings(runs)] == ["streak, medium", "raindrop, light"]
    for found in rankings(runs):
        title = found.title.capitalize()
        for head, *rows in (tables[f"{title}, {suite} suite, demo, given-poses"], tables_by_name(scene)[title]):
            names = [text for text, _ in head]
            assert names[:4] == ["Rank", "Method", metrics[0].title, "Gain over 3dgs"]
            assert [row[1][0] for row in rows] == [ranked.method for ranked in found.methods]
            assert "nerf-w" not in [row[1][0] for row in rows]  # its only run failed
            for ranked, row in zip(found.methods, rows, strict=True):
                cells = dict(zip(names, row, strict=True))
                assert cells["Rank"][0] == ("" if ranked.rank is None else str(ranked.rank))
                assert has_scores_and_gain(cells, ranked)  # no interval of one scene
                assert shows(cells["Seconds"], ranked.seconds, cost_text)
                assert cells["Scenes"][0] == "1 scene"
                is_best = ranked.rank is not None and found.best["psnr"] == ranked.scores["psnr"]
                assert ("best" in cells[metrics[0].title][1]["class"].split()) == is_best


def test_a_method_has_its_paper_authors_code_and_licence_on_a_page_that_the_ranking_leads_to(written, pages):
    index, page = pages[written / "site" / "index.html"], one(pages, f"/{method_page('3dgs')}")
    address = f"methods/{method_page('3dgs')}"
    assert [a["href"] for a in index.all("a")].count(address) == 2 * 2 + 1  # rankings, and the list of methods
    cited = citation_of("3dgs")
    told = (cited.title, cited.paper, cited.authors, str(cited.year), cited.licence, "hydroviews eval 3dgs\n")
    assert all(words in page.text for words in told)
    assert papers_and_code("3dgs") <= {a["href"] for a in page.all("a")}
    assert "With +enhance" not in page.text
    theirs = one(pages, method_page(THEIRS)).text
    assert "Submitted by <b>Ada</b>" in theirs
    assert "hydroviews eval" not in theirs


@pytest.mark.parametrize("method", ["3dgs-clean", "deraings"])
def test_the_page_of_a_method_has_its_scores_by_rain_and_unfolds_them_by_scene(written, pages, method):
    table, page = collect(written), one(pages, f"/{method_page(method)}")
    tables = tables_by_name(page)
    assert len(page.all("details")) == 2 * len(SCENE_OF)
    for suite, scene in SCENE_OF.items():
        for found in rankings(runs_of_suite(table, suite)):
            ranked, title = next(r for r in found.methods if r.method == method), found.title.capitalize()
            head, *rows = tables[f"Scores, {suite} scenes, demo, given-poses"]
            [row] = [row for row in rows if row[0][0] == title]
            scene_head, scene_row = tables[f"{title} by scene, {suite} scenes, demo, given-poses"]
            assert scene_row[0][0] == scene
            assert scene_row[[text for text, _ in scene_head].index("Seeds")][0] == "0"
            for names, own in ((head, row), (scene_head, scene_row)):
                assert has_scores_and_gain(dict(zip([text for text, _ in names], own, strict=True)), ranked)
    paper = [found for found in page.tables if found[0][-1][0] == "PSNR (paper)"]
    assert [found[1][-1][0] for found in paper] == (["27.41"] if method == "deraings" else [])


def test_links_to_the_documentation_and_of_submitters_and_the_day_of_publication(copied, rewritten):
    edit(on_pond(copied, THEIRS_IN_RECORDS, "raindrop-0") / "record.json", link="https://[abc")  # of before
    write_json(copied / PUBLICATION, {"date": "2026-01-02", "version": "1.0.0+abc"})
    for docs in ("", "https://example.org/docs/", "../../"):
        rewritten(docs)
        index = Page(copied / "site" / "index.html")
        assert "Published on 2026-01-02 with version 1.0.0+abc." in index.text
        found = {a["href"] for a in index.all("a") if a["href"].endswith("board.html#submit-renders")}
        assert found == ({f"{docs}leaderboard/board.html#submit-renders"} if docs else set())
    page = Page(copied / "site" / "methods" / method_page("3dgs"))
    assert "../../../methods/index.html" in {a["href"] for a in page.all("a")}
    names = ("demo", THEIRS_IN_RECORDS, "pond", "raindrop-0", "0", "given-poses")
    text = Page(copied / "site" / "runs" / page_name(*names)).text
    assert "Submitted by <b>Ada</b>." in text  # without a link to what is no address


def test_quality_is_drawn_against_every_cost_with_a_point_a_method(written, pages):
    labels = [a["aria-label"] for a in pages[written / "site" / "index.html"].all("svg")]
    psnr, table = find_metrics()[0], collect(written)
    for suite in SCENE_OF:
        means = cost_means(blocks(runs_of_suite(table, suite))[-1].rows).dropna(subset=["psnr"])
        assert len(means) > 2
        for name in PLOTTED:
            told = [
                f"{method} {psnr.title} {psnr.text(row['psnr'])}, {COST_TITLES[name]} {cost_text(row[name])}"
                for method, row in means.to_dict("index").items()
            ]
            assert any(all(words in label for words in told) for label in labels), (suite, name)


def test_everything_has_a_name_for_who_does_not_see(pages):
    for page in pages.values():
        assert len(page.all("table")) == len(page.all("caption"))
        assert all("scope" in attributes for attributes in page.all("th"))
        assert all("alt" in attributes for attributes in page.all("img"))
        assert all(attributes.get("loading") == "lazy" for attributes in page.all("img") if "src" in attributes)
        assert all(attributes.get("aria-label") or "aria-hidden" in attributes for attributes in page.all("svg"))
        assert page.all("html")[0]["lang"] == "en"
        ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
        assert len(ids) == len(set(ids))
        assert len(page.all("label")) == len(page.all("input")) + len(page.all("select"))


def test_the_viewer_has_renders_of_all_methods_and_they_are_the_runs(written, pages):
    path, page = next((path, page) for path, page in pages.items() if path.name.startswith("pond"))
    pictures = json.loads(page.scripts[0])
    assert list(pictures) == ["raindrop-0, seed 0", "streak-1, seed 0"]
    shown = pictures["streak-1, seed 0"]
    assert (next(iter(shown)), len(shown)) == ("3dgs-clean", 4)
    assert list(shown["deraings"]) == ["000", "016", "024"]
    small = np.asarray(Image.open(path.parent.parent / "pictures" / shown["deraings"]["016"]), float)
    render = np.asarray(Image.open(on_pond(written, "deraings") / "renders" / "016.png"), float)
    assert np.abs(small - render).mean() < 6


def test_published_numbers_stand_beside_ours(pages):
    page = one(pages, "scenes/mipnerf360-bonsai")
    table = next(found for found in page.tables if found[0][-1][0] == "LPIPS (paper)")
    row = next(row for row in table if row[1][0] == "deraings")
    assert [text for text, _ in row[-3:]] == ["27.41", "0.877", "0.173"]
    assert "are not our runs" in page.text


def test_pictures_are_written_once_and_what_is_gone_goes(copied, rewritten):
    site = copied / "site"
    before = {path: path.stat().st_mtime_ns for path in site.rglob("*.*")}
    rewritten()
    assert {path: path.stat().st_mtime_ns for path in site.rglob("*.*")} == before
    shutil.rmtree(on_pond(copied, "deraings"))
    rewritten()
    gone = set(before) - set(site.rglob("*.*"))
    assert sorted(path.suffix for path in gone) == [".html", ".webp", ".webp", ".webp"]


def test_a_run_that_is_removed_meanwhile_does_not_end_the_pages(copied, monkeypatch):
    table, is_file, folder = collect(copied), Path.is_file, on_pond(copied, "3dgs")

    def removing(path):
        there = is_file(path)
        if path == folder / LEARNING_CURVE:
            shutil.rmtree(folder)
        return there

    monkeypatch.setattr(Path, "is_file", removing)
    write_site(table, copied, copied / "no data")
    assert not folder.exists()
    page = Page(copied / "site" / "runs" / page_name("demo", "3dgs", "pond", "streak-1", "0", "given-poses"))
    assert page.all("svg") == []
    assert "Learning curve" not in page.text


def test_a_render_that_is_no_picture_is_left_out_with_a_warning(copied, rewritten, caplog):
    (on_pond(copied, "deraings") / "renders" / "016.png").write_bytes(b"not a picture")
    rewritten()
    assert "016.png: not on the pages" in caplog.text
    page = Page(next((copied / "site" / "scenes").glob("pond*")))
    assert list(json.loads(page.scripts[0])["streak-1, seed 0"]["deraings"]) == ["000", "024"]


def test_rainy_and_clean_views_are_those_of_the_data_that_were_run_on(evaluated, tmp_path, caplog):
    results, data = tmp_path / "results", tmp_path / "data"
    write_site(collect(results), results, data)
    [scene] = (results / "site" / "scenes").iterdir()
    shown = json.loads(Page(scene).scripts[0])["streak-0, seed 0"]
    assert list(shown)[:2] == ["clean view", "rainy view"]
    views = set(shown[list(shown)[-1]])
    assert set(shown["clean view"]) == set(shown["rainy view"]) == views != set()
    assert all(shown["clean view"][view] != shown["rainy view"][view] for view in views)
    for path in results.glob("*/*/*/streak-0/*/record.json"):
        edit(path, data_sha256="of an older build")
    with caplog.at_level(logging.WARNING):
        write_site(collect(results), results, data)
    assert "not the data that the runs under streak-0 were made on" in caplog.text
    assert "rainy view" not in json.loads(Page(scene).scripts[0])["streak-0, seed 0"]
