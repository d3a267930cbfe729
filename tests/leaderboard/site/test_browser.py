"""The pages in Chromium: sorted, filtered, slid, opened by deep links, without errors, network or barriers."""

import shutil
from pathlib import Path

import pytest

sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install '.[browser]'")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = pytest.mark.skipif(not CHROMIUM, reason="needs Chromium: apt-get install chromium")

DESKTOP, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def browser():
    with sync_api.sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture
def page(browser):
    """A page that may say nothing on the console, ask nothing, and load from disk alone."""
    context = browser.new_context(viewport=DESKTOP)
    opened, troubles = context.new_page(), []
    opened.on("console", lambda message: troubles.append(message.text))
    opened.on("pageerror", lambda error: troubles.append(str(error)))
    opened.on("dialog", lambda dialog: (troubles.append(dialog.message), dialog.dismiss()))
    opened.on("request", lambda asked: None if asked.url.startswith(("file:", "data:")) else troubles.append(asked.url))
    opened.on("requestfailed", lambda asked: troubles.append(f"not there: {asked.url}"))
    yield opened
    assert troubles == []
    context.close()


def index(written: Path) -> str:
    return (written / "site" / "index.html").as_uri()


def scene(written: Path) -> str:
    return next((written / "site" / "scenes").glob("pond*")).as_uri()


def column(page, key: str) -> list[str]:
    """The texts of a column of all runs, as far as they are shown."""
    return page.evaluate(
        """key => { const table = document.getElementById("all-runs");
        const at = table.querySelector(`th[data-key="${key}"]`).cellIndex;
        return Array.from(table.tBodies[0].rows).filter(row => row.checkVisibility())
            .map(row => row.cells[at].textContent); }""",
        key,
    )


def test_columns_sort_both_ways_with_what_is_empty_last(page, written):
    page.goto(index(written))
    head = page.locator("#all-runs th[data-key=psnr]")
    for direction in ("descending", "ascending"):
        head.locator("button").focus()
        page.keyboard.press("Enter")
        assert head.get_attribute("aria-sort") == direction
        texts = column(page, "psnr")
        assert texts[-1] == ""  # the failed run
        numbers = [float(text) for text in texts[:-1]]
        assert numbers == sorted(numbers, reverse=direction == "descending")
    page.locator("#all-runs th[data-key=grade] button").click()
    assert column(page, "grade") == ["light"] * 6 + ["medium"] * 7 + [""] * 2
    assert page.locator("#all-runs th[aria-sort]").count() == 1


def test_filters_and_the_address_that_keeps_them(page, written):
    page.goto(index(written))
    assert len(column(page, "method")) == 15
    page.locator("select[name=effect]").select_option("raindrop")
    page.locator("select[name=scene]").select_option("pond")
    assert set(column(page, "pattern")) == {"raindrop-0"}
    assert page.locator("output").text_content() == "3 of 15 runs"
    page.get_by_role("searchbox", name="Method").fill("DERAIN")
    assert column(page, "method") == ["deraings"]
    page.locator("#all-runs th[data-key=psnr] button").click()
    address = page.url
    assert {"effect=raindrop", "scene=pond", "method=DERAIN", "sort=psnr"} <= set(address.split("#")[1].split("&"))
    page.get_by_role("button", name="Show all").click()
    page.wait_for_function("document.querySelector('output').textContent === '15 runs'")
    page.goto("about:blank")
    page.goto(address)
    assert column(page, "method") == ["deraings"]
    assert page.locator("#all-runs th[data-key=psnr]").get_attribute("aria-sort") == "descending"
    page.locator("#all-runs tbody a:visible").click()
    assert "deraings" in page.locator("h1").text_content()
    assert "hydroviews eval deraings --scene pond" in page.locator("pre").text_content()


def test_the_slider_shows_any_two_and_their_difference(page, written):
    page.goto(scene(written))
    page.locator("select[name=left]").select_option("3dgs")
    page.locator("select[name=right]").select_option("deraings")
    page.locator("select[name=pattern]").select_option("streak-1, seed 0")
    page.locator("select[name=view]").select_option("016")
    sources = [page.locator(f".compare .{name}").get_attribute("src") for name in ("under", "over")]
    assert len(set(sources)) == 2
    page.wait_for_function("Array.from(document.querySelectorAll('.compare img')).every(i => i.naturalWidth === 64)")
    assert page.locator(".compare .over").get_attribute("alt") == "deraings, view 016"
    page.get_by_role("slider", name="Between left and right").focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    clip = "getComputedStyle(document.querySelector('.compare .over')).clipPath"
    assert page.evaluate(clip).endswith(" 53%)")
    page.get_by_label("Difference, times 4").check()
    assert page.evaluate(clip) == "none"
    assert page.evaluate("getComputedStyle(document.querySelector('.compare .over')).mixBlendMode") == "difference"
    address = page.url
    page.goto("about:blank")
    page.goto(address)
    assert [page.locator(f".compare .{name}").get_attribute("src") for name in ("under", "over")] == sources
    assert page.get_by_label("Difference, times 4").is_checked()


def test_an_address_that_names_nothing_known_opens(page, written):
    page.goto(scene(written) + "#pattern=none&left=<b>&view=9&cut=x&right=__proto__")
    assert page.locator(".compare .over").get_attribute("src").endswith(".webp")
    page.goto(index(written) + "#effect=none&sort=nothing")
    assert len(column(page, "method")) == 15


def test_the_ranking_is_on_the_first_screen_of_a_phone_and_leads_to_scores_by_scene(page, shipped):
    page.set_viewport_size(PHONE)
    page.goto(index(shipped))
    rows = page.locator("table.ranking").first.locator("tbody tr")
    assert rows.nth(2).bounding_box()["y"] < PHONE["height"]
    rows.locator("a", has_text="deraings").first.click()
    assert page.locator("details > summary").count() == 4
    assert not page.locator("details table").first.is_visible()
    page.locator("details > summary").first.click()
    assert page.locator("details table").first.is_visible()
    page.go_back()
    page.locator("#scenes a").first.click()
    assert page.get_by_text("These runs have no pictures").is_visible()
    assert page.locator("img, input[type=range]").count() == 0


@pytest.mark.parametrize("board", ["written", "shipped"])
@pytest.mark.parametrize(("size", "scheme"), [(DESKTOP, "light"), (PHONE, "dark")], ids=["desktop", "phone"])
def test_axe_finds_nothing_serious_and_nothing_is_wider_than_the_screen(browser, request, board, size, scheme):
    written = request.getfixturevalue(board)
    axe = pytest.importorskip("axe_playwright_python", reason="needs axe: pip install '.[browser]'")
    source = (Path(axe.__file__).parent / "axe.min.js").read_text()
    context = browser.new_context(viewport=size, color_scheme=scheme)
    opened = context.new_page()
    others = [next((written / "site" / folder).iterdir()).as_uri() for folder in ("runs", "methods")]
    for address in (index(written), scene(written), *others):
        opened.goto(address)
        opened.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
        opened.evaluate(source)
        found = opened.evaluate("axe.run({ preload: false })")
        told = [(fault["id"], fault["impact"], fault["nodes"][0]["html"]) for fault in found["violations"]]
        assert [fault for fault in told if fault[1] in ("serious", "critical")] == []
        assert len(found["passes"]) > 10
        assert opened.evaluate("document.documentElement.scrollWidth") <= size["width"]
    context.close()
