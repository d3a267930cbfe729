"""Tables on pages of Markdown, filled from records: numbers against pandas, what is odd refused, the rest untouched."""

import itertools
import re

import numpy as np
import pandas as pd
import pytest
from made_up_board import run_row

from hydroviews.errors import InputError
from leaderboard.gather import VIEW_KEYS
from leaderboard.publishing import board_tables
from leaderboard.publishing.board_tables import filled
from leaderboard.records import columns
from leaderboard.tables.comparison import compare

SHIFT = {"3dgs-clean": 6.0, "3dgs": 0.0, "ours": 3.0, "theirs": 4.0}
PLACES = ("room", "pond", "street", "courtyard", "llff_flower", "mine")
PATTERNS = ("raindrop-1", "raindrop-2", "streak-1")
HEAD = "| suite | rain | `3dgs-clean`, the ceiling | [`ours`](ours.md) | `3dgs` |\n|---|---|---|---|---|"


def board(without=()):
    """Runs and views with scores of a scene, a method and luck; `without` are methods and scenes that have no run."""
    rng = np.random.default_rng(0)
    views = []
    for method, (number, scene) in itertools.product(SHIFT, enumerate(PLACES)):
        for pattern in ["clean"] if method == "3dgs-clean" else PATTERNS:
            if (method, scene) not in without:
                scores, run = rng.normal(20 + number + SHIFT[method], 0.5, 4), run_row(method, scene, pattern)
                views += [run | {"view": f"v{i}", "psnr": score} for i, score in enumerate(scores)]
    found = pd.DataFrame(views, columns=[*VIEW_KEYS, "view", "psnr"])
    runs = found.groupby([name for name in VIEW_KEYS if name != "suite"], as_index=False).psnr.mean()
    versions = {"3dgs": "0.2.0+1", "3dgs-clean": "0.2.0+1, then 0.2.0+2"}  # trained in two sessions
    runs["version"] = runs.method.map(lambda method: versions.get(method, "0.2.0+2"))
    return runs.assign(status="done").reindex(columns=columns()), found


def page(kind: str, *patterns: str, head: str = HEAD) -> str:
    start = f"<!-- board: demo {kind} {' '.join(patterns)} -->"
    return f"# Title\n\nBefore.\n\n{start}\n\n{head}\n\n<!-- /board -->\n\nAfter.\n"


def cells(text: str) -> dict[tuple[str, str], list[str]]:
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    return {(row[0], row[1]): row[2:] for row in lines[2:]}


def test_suites_have_means_and_from_enough_scenes_on_the_interval_of_the_comparison(monkeypatch):
    table, views = board()
    few = cells(filled(page("suites", "streak-1"), table, views))
    assert all(re.fullmatch(r"(\*\*)?[\d.]+(\*\*)?( \(\+[\d.]+\))?", cell) for row in few.values() for cell in row)
    monkeypatch.setattr(board_tables, "LEAST_SCENES", 3)
    found = cells(filled(page("suites", "raindrop-1", "streak-1"), table, views))
    suites = ("test, 3 scenes", "development, 2 scenes")
    assert list(found) == [(suite, f"{rain}, medium") for suite in suites for rain in ("raindrop", "streak")]
    own = views[views.scene.isin(PLACES[:3]) & views.pattern.isin(["streak-1", "clean"])]
    scenes = own.pivot_table(index="scene", columns="method", values="psnr")
    ceiling, ours, floor = found["test, 3 scenes", "streak, medium"]
    assert floor == f"{scenes['3dgs'].mean():.2f}"
    runs = table[table.scene.isin(PLACES[:3]) & (table.pattern == "streak-1")]
    pair = compare(runs, own, "psnr", ["ours", "3dgs"]).pairs
    gain, half = pair.difference[0], (pair.high[0] - pair.low[0]) / 2
    assert ours == f"**{scenes['ours'].mean():.2f}** ({gain:+.2f} ± {half:.2f})"
    gains = scenes["3dgs-clean"] - scenes["3dgs"]  # Student's t of three scenes
    mean, gain, half = map(float, re.fullmatch(r"([\d.]+) \((\+[\d.]+) ± ([\d.]+)\)", ceiling).groups())
    assert (mean, gain) == pytest.approx((scenes["3dgs-clean"].mean(), gains.mean()), abs=0.005)
    assert half == pytest.approx(4.302653 * gains.std(ddof=1) / np.sqrt(3), rel=0.05)  # the bootstrap draws


def test_scenes_have_scores_and_shares_of_the_gap():
    table, views = board()
    head = HEAD.replace("suite", "")  # its cell may be empty
    found = cells(filled(page("scenes", "streak-1", head=head), table, views))
    names = ["pond", "room", "street", "courtyard (development)", "llff_flower (development)"]
    assert [scene for scene, _ in found] == names  # none that is in no suite
    means = views[(views.scene == "pond") & views.pattern.isin(["streak-1", "clean"])].groupby("method").psnr.mean()
    share = (means["ours"] - means["3dgs"]) / (means["3dgs-clean"] - means["3dgs"])
    shown = [f"{means['3dgs-clean']:.2f}", f"**{means['ours']:.2f}** ({100 * share:.0f} %)", f"{means['3dgs']:.2f}"]
    assert found["pond", "streak, medium"] == shown


def test_methods_have_a_row_each_in_order_of_their_means():
    table, views = board(without=[("theirs", "pond")])
    table["before_s"], table["train_s"] = 5.0, np.where(table.method == "ours", 70.0, 30.0)
    table["after_s"] = np.where(table.method == "ours", 20.0, np.nan)  # older records have none
    head = "| method | `room` | `courtyard` (development) | `pond` | seconds |\n|---|---|---|---|---|"
    text = filled(page("methods", "raindrop-1", "streak-1", head=head), table, views)
    found = cells(text)
    assert [method for method, _ in found] == ["`3dgs-clean`", "`ours`", "`3dgs`", "`theirs`"]  # it lacks a scene
    own = views[views.scene.isin(["room", "courtyard", "pond"])]
    means = own.groupby(["method", "scene", "pattern"]).psnr.mean()
    shown = {method: [first, *others] for (method, first), others in found.items()}
    assert shown["`3dgs-clean`"][:2] == [f"{means['3dgs-clean', s, 'clean']:.2f}" for s in ("room", "courtyard")]
    drops, streaks = means["theirs", "room"][["raindrop-1", "streak-1"]]
    assert shown["`theirs`"] == [f"**{drops:.2f}**, **{streaks:.2f}**", *shown["`theirs`"][1:2], "", "35"]
    drops, streaks = means["ours", "pond"][["raindrop-1", "streak-1"]]
    assert shown["`ours`"][2:] == [f"**{drops:.2f}**, **{streaks:.2f}**", "95"]
    assert "PSNR in dB under raindrop-1, streak-1. Seconds: mean over runs, before, in and after training." in text
    assert "Profile `demo` (longer side at most 320 pixels), seed 0." in text
    assert filled(text, table, views) == text


def test_what_a_method_lacks_is_a_dash_and_unknown_seconds_are_empty():
    table, views = board()
    table[["before_s", "after_s"]], table["train_s"] = np.nan, np.where(table.method == "ours", np.nan, 30.0)
    table = table[(table.method != "ours") | (table.pattern != "streak-1") | (table.scene != "mine")]
    head = "| method | `mine` | seconds |\n|---|---|---|"  # a scene of no suite
    found = cells(filled(page("methods", "raindrop-1", "streak-1", head=head), table, views))
    seconds = {method: row[-1] for (method, _), row in found.items()}
    assert seconds == {"`3dgs-clean`": "30", "`theirs`": "30", "`ours`": "", "`3dgs`": "30"}
    [ours] = [scores for method, scores in found if method == "`ours`"]
    assert re.fullmatch(r"[\d.]+, -", ours)


def test_runs_of_other_tracks_and_methods_that_no_column_names_change_nothing():
    runs = board()
    more = (pd.concat([one, one.assign(track="sparse-views", psnr=one.psnr - 5)], ignore_index=True) for one in runs)
    suites = page("suites", "streak-1")
    text = suites + page("scenes", "streak-1") + page("methods", "streak-1", head="| method | `pond` |\n|---|---|")
    assert filled(text, *more) == filled(text, *runs)
    assert filled(suites, *board(without=[("theirs", scene) for scene in PLACES[:5]])) == filled(suites, *runs)


def test_means_are_over_the_scenes_that_all_of_them_have():
    table, views = board(without=[("ours", "room"), ("3dgs-clean", "street")])
    found = cells(filled(page("suites", "streak-1"), table, views))
    ceiling, ours, floor = found["test, 2 scenes", "streak, medium"]  # pond and street
    own = views[views.scene.isin(["pond", "street"]) & (views.pattern == "streak-1")]
    means = own.groupby(["method", "scene"]).psnr.mean().groupby("method").mean()
    assert ours.startswith(f"<u>{means['ours']:.2f}</u> (+")
    assert floor == f"**{means['3dgs']:.2f}**"
    assert "(" not in ceiling  # street has none: a gain would be of other scenes
    scenes = cells(filled(page("scenes", "streak-1"), table, views))
    assert scenes["room", "streak, medium"][1] == scenes["street", "streak, medium"][0] == ""


def test_what_is_around_a_table_stays_and_a_second_time_changes_nothing():
    text = page("suites", "streak-1") + page("scenes", "raindrop-2")
    once = filled(text, *board())
    start = "# Title\n\nBefore.\n\n<!-- board: demo suites streak-1 -->\n\n| suite | rain | `3dgs-clean`, the"
    assert once.startswith(start)
    assert once.count("\n\nAfter.\n") == 2
    assert "raindrop, heavy" in once
    assert once.count("seed 0. The record of each run names its code.\n") == 2
    assert filled(once, *board()) == once
    assert filled("No table.", *board()) == "No table."


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (page("suits", "streak-1"), "not as it has to be"),
        (page("suites", "streak-1").replace("<!-- /board -->", ""), "not as it has to be"),
        (page("suites", "streak-1").replace("demo ", ""), "not as it has to be"),
        ("<!-- /board -->", "not as it has to be"),
        (page("suites", "streak-1", head="| a | b |\n|---|---|"), "a head without methods"),
        (page("suites", "streak-1", head="| a | b | `3dgs` | ours |"), "a head without methods"),
        (page("suites", "streak-1", head=""), "a head without methods"),
        (page("suites", "streak-1", head="| a | b | `3dgz` |"), "did you mean 3dgs"),
        (page("suites", "storm-1"), "no such run"),
        (page("methods", "storm-1", head="| method | `pond` |\n|---|---|"), "no such run"),
        (page("methods", "streak-1", head="| method | pond |\n|---|---|"), "a head without scenes"),
        (page("methods", "streak-1", head="| method | `pund` |\n|---|---|"), "did you mean pond"),
    ],
)
def test_odd_tables_are_refused(text, message):
    with pytest.raises(InputError, match=message):
        filled(text, *board())


def test_scores_of_methods_are_over_the_seeds_that_all_of_them_have():
    table, views = board(without=[("theirs", "pond")])
    more = [table[table.method.isin(["ours", "3dgs-clean"])].assign(seed=seed, psnr=50.0) for seed in (1, 2)]
    more.append(table[(table.method == "3dgs") & (table.scene == "pond")].assign(seed=1, psnr=40.0))
    both, head = pd.concat([table, *more], ignore_index=True), "| method | `room` | `pond` |\n|---|---|---|"
    text = filled(page("methods", "raindrop-1", "streak-1", head=head), both, views)
    once = filled(page("methods", "raindrop-1", "streak-1", head=head), table, views)
    shown, alone = ({method: [room, pond] for (method, room), (pond,) in cells(one).items()} for one in (text, once))
    assert {method: room for method, (room, _) in shown.items()} == {m: room for m, (room, _) in alone.items()}
    psnr = table[(table.scene == "pond") & (table.pattern == "streak-1")].set_index("method").psnr
    assert shown["`ours`"][1].endswith(f"**{(psnr['ours'] + 50) / 2:.2f}**")  # of pond two have seeds 0 and 1
    assert shown["`3dgs`"][1].endswith(f"{(psnr['3dgs'] + 40) / 2:.2f}")
    clean = table[(table.scene == "pond") & (table.pattern == "clean")].psnr.item()
    assert shown["`3dgs-clean`"][1] == f"{(clean + 50) / 2:.2f}"
    assert "seeds 0, 1. The record" in text
