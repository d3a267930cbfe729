"""Where methods stand apart, a second block has the numbers of all of them on the runs that all of them have."""

import pandas as pd
import pytest
from made_up_board import write_board as make_runs

from leaderboard.gather import collect, collect_views, write_leaderboard
from leaderboard.publishing.board_pages import comparisons_text
from leaderboard.site.write import write_site
from leaderboard.tables.dataframes import suite_blocks
from leaderboard.tables.markdown import SHARED, scene_text
from leaderboard.tables.means import blocks

PATTERNS = ("raindrop-0", "raindrop-1", "raindrop-2")
SHARED_RUNS = "pond; raindrop-1; seed 0"
TOLD = f"3 methods on the runs that all of them have: {SHARED_RUNS}."


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Two methods with nine runs each on a test scene, and `few` with one of these."""
    folder = tmp_path_factory.mktemp("results")
    make_runs(folder, ("3dgs", "3dgs-clean", "ours"), ("pond",), PATTERNS, (0, 1, 2), n_views=2, size=(16, 16))
    make_runs(folder, ("few",), ("pond",), ("raindrop-1",), n_views=2, size=(16, 16))
    write_site(write_leaderboard(folder), folder, folder / "no data")
    return folder


def own_run(results, method: str) -> pd.Series:
    """The run of a method that all have."""
    table = collect(results)
    return table[(table.method == method) & table.pattern.isin(["raindrop-1", "clean"]) & (table.seed == 0)].iloc[0]


@pytest.mark.parametrize(("name", "n_first"), [("tables", 4), ("grades", 7), ("costs", 4)])
def test_the_csv_has_every_method_in_rows_that_name_their_runs(results, name, n_first):
    found = pd.read_csv(results / f"{name}.csv").fillna({"shared_runs": ""})
    first, second = found[found.shared_runs == ""], found[found.shared_runs != ""].set_index("method")
    assert len(first) == n_first
    assert first[first.method == "few"].psnr.isna().all()
    assert set(second.shared_runs) == {SHARED_RUNS}
    assert set(second.index) == {"3dgs", "few", "ours"} | ({"3dgs-clean"} if name != "grades" else set())
    for method, row in second.iterrows():
        run = own_run(results, method)
        numbers = ["psnr", "ssim", "lpips_vgg", "train_s", "peak_mem_mb", "n_primitives"]
        assert list(row[numbers].astype(float)) == pytest.approx(list(run[numbers].astype(float)))
        assert row.finished == row.planned == row.compared == 1


def test_the_markdown_has_scores_and_costs_of_every_method_and_says_of_which_runs(results):
    text, run = (results / "tables.md").read_text(), own_run(results, "few")
    scene, suite = text.split("## suite test")
    assert "| few |  |  |  |  |  |  | <u>1/9</u> |" in scene
    second = scene.split("fewer than half.")[1]
    assert TOLD in second
    line = next(line for line in second.splitlines() if line.startswith("| few |"))
    assert f"{run.ssim:.4f}" in line
    assert line.endswith(" 1/1 |")
    assert second.count("**") == 2 * 4  # the best of every metric
    costs = suite.split(f"### {SHARED}")[1]
    assert TOLD in costs
    line = next(line for line in costs.splitlines() if line.startswith("| few |") and "cpu" in line)
    assert f" {run.peak_mem_mb:,.0f} |" in line or f" {run.peak_mem_mb:.1f} |" in line
    assert TOLD in scene_text(collect(results), "pond", "demo", "given-poses")


def test_comparisons_rank_all_methods_among_themselves(results):
    table = collect(results)
    text = comparisons_text(table, collect_views(table, results))
    first, second = (part.split("\n\n## ")[0] for part in text.split(f"{SHARED} ({SHARED_RUNS})")[:2])
    assert "| few |" not in first.split("## ")[1]
    assert "few" in first
    assert second.count(" 1/1 |") == 3
    assert "Means over the 1 runs that all of them have, on 1 scene, 2 views." in second
    assert text.count(SHARED) == 4  # metrics


def test_where_all_are_compared_or_nothing_more_is_shared_there_is_one_block(results):
    table = collect(results)
    alone = table.assign(data_sha256=table.data_sha256.where(table.method != "few", "of an older build"))
    for rows in (table[table.method != "few"], alone, table.assign(status="failed")):
        assert [block.shared_runs for block in blocks(rows)] == [""]
        assert [len(found) for found in suite_blocks(rows).values()] == [1]
    assert sorted(set(blocks(table)[1].rows.method)) == ["3dgs", "3dgs-clean", "few", "ours"]
