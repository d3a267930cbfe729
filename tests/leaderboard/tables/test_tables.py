import pandas as pd
import pytest

from hydroviews.metrics import find_metrics
from leaderboard.records import columns
from leaderboard.tables.dataframes import cost_means, grade_of, scene_keys, scene_table, share_of_gap
from leaderboard.tables.markdown import to_markdown
from leaderboard.tables.means import places, shared_runs


def rows(*values: tuple) -> pd.DataFrame:
    records = [
        dict.fromkeys(columns())
        | {
            "pattern": effect if effect == "clean" else f"{effect}-0",
            "seed": [other[:2] for other in values[:i]].count((method, effect)),
            "data_sha256": effect,
            "method": method,
            "effect": effect,
            "status": status,
            "psnr": psnr,
            "ssim": 0.5,
            "scene": "yard",
            "profile": "demo",
            "track": "given-poses",
        }
        for i, (method, effect, status, psnr) in enumerate(values)
    ]
    return pd.DataFrame(records)


def test_means_share_of_gap_and_order():
    table = rows(
        ("ours", "streak", "done", 24.0),
        ("ours", "streak", "done", 26.0),
        ("3dgs", "streak", "done", 20.0),
        ("3dgs", "streak", "done", 20.0),
        ("3dgs-clean", "clean", "done", 30.0),
        ("3dgs-clean", "clean", "done", 30.0),
    )
    summary = scene_table(table, "yard", "demo", "given-poses")["streak"]
    assert list(summary.index) == ["3dgs-clean", "3dgs", "ours"]
    assert summary.loc["ours", "psnr"] == 25
    assert summary.loc["ours", "gap"] == pytest.approx(0.5)
    assert summary.loc["3dgs", "gap"] == 0
    assert summary.loc["3dgs-clean", "gap"] == 1


def test_the_gap_is_taken_on_the_runs_that_have_both_references():
    table = rows(
        ("3dgs", "streak", "done", 26.0),
        ("3dgs", "streak", "done", 14.0),
        ("ours", "streak", "done", 25.0),
        ("theirs", "streak", "done", 29.0),
        ("3dgs-clean", "clean", "done", 30.0),
    )
    table["pattern"] = ["streak-0", "streak-2", "streak-0", "streak-0", "clean"]
    table["seed"] = 0
    table.loc[3, "data_sha256"] = "an older build of the scene"
    summary = scene_table(table, "yard", "demo", "given-poses")["streak"]
    assert summary.loc["ours", "gap"] == pytest.approx(-0.25)
    assert pd.isna(summary.loc["theirs", "gap"])
    assert summary.loc["3dgs-clean", "gap"] == 1


def test_the_share_of_the_gap_is_of_the_means_beside_it_where_patterns_have_unlike_numbers_of_seeds():
    """In three seeds of one pattern half the gap is won, in one of another a tenth."""
    runs = [(name, "streak", "done", psnr) for name, psnr in (("3dgs", 10.0), ("ours", 20.0)) for _ in range(3)]
    runs += [(name, "raindrop", "done", psnr) for name, psnr in (("3dgs", 20.0), ("ours", 21.0))]
    table = rows(*runs, *[("3dgs-clean", "clean", "done", 30.0)] * 3)
    table["effect"] = table.effect.mask(table.effect == "raindrop", "streak")  # another pattern of the same effect
    summary = scene_table(table, "yard", "demo", "given-poses")["streak"]
    floor, ours = summary.psnr[["3dgs", "ours"]]
    assert (floor, ours) == (15, 20.5)
    assert summary.gap["ours"] == pytest.approx((ours - floor) / (30 - floor))


@pytest.mark.parametrize("lacking", ["3dgs", "3dgs-clean", "ours"])
def test_no_share_is_told_of_runs_that_lack_a_score(lacking):
    """Means of three methods over other runs would be of no gap at all."""
    table = rows(
        *((name, "streak", "done", psnr) for name, psnr in (("3dgs", 20.0), ("ours", 25.0))),
        *((name, "streak", "done", psnr) for name, psnr in (("3dgs", 10.0), ("ours", 11.0))),
        *[("3dgs-clean", "clean", "done", 30.0)] * 2,
    )
    assert share_of_gap(table, "ours") == pytest.approx((18 - 15) / (30 - 15))
    table.loc[table.index[table.method == lacking][0], "psnr"] = float("nan")
    assert pd.isna(share_of_gap(table, "ours"))


def test_failed_runs_are_counted_and_left_out_of_the_mean():
    table = rows(
        ("ours", "streak", "done", 24.0),
        ("ours", "streak", "failed", None),
        ("theirs", "streak", "failed", None),
        ("3dgs-clean", "clean", "done", 30.0),
    )
    board = scene_table(table, "yard", "demo", "given-poses")
    summary = board["streak"]
    assert summary.loc["ours", "psnr"] == 24
    assert (summary.loc["ours", "finished"], summary.loc["ours", "planned"]) == (1, 2)
    assert pd.isna(summary.loc["theirs", "psnr"])
    text = to_markdown(board)
    assert "| ours | <u>**24.00**</u> | <u>**0.5000**</u> |  |  |  |  | <u>1/2</u> |" in text
    assert "| theirs |  |  |  |  |  |  | <u>0/2</u> |" in text
    assert "Means over 1 of 2 runs, which all the others have. Without a finished run: theirs." in text


def test_where_a_run_lacks_a_number_its_mean_is_not_told():
    table = rows(("ours", "streak", "done", 24.0), ("ours", "streak", "partial", None))
    assert pd.isna(scene_table(table, "yard", "demo", "given-poses").loc["ours", ("streak", "psnr")])


def test_means_are_of_shared_runs_and_who_lacks_runs_is_underlined_and_not_the_best():
    table = rows(
        ("ours", "streak", "done", 29.0),
        ("ours", "streak", "failed", None),
        ("theirs", "streak", "done", 24.0),
        ("theirs", "streak", "done", 10.0),
        ("thirds", "streak", "done", 23.0),
        ("thirds", "streak", "done", 40.0),
    )
    board = scene_table(table, "yard", "demo", "given-poses")
    assert dict(board["streak"].psnr) == {"ours": 29, "theirs": 24, "thirds": 23}  # seed 1 counts for nobody
    assert places(board["streak"], find_metrics()[0]) == {"ours": 3, "theirs": 1, "thirds": 2}
    text = to_markdown(board)
    assert "| ours | <u>29.00</u> |" in text
    assert "| theirs | **24.00** |" in text
    assert "Means over 1 of 2 runs, which all of them have." in text


def test_a_method_that_lacks_most_runs_leaves_the_others_theirs():
    runs = {"ours": {1, 2, 3, 4, 5}, "theirs": {1, 2, 3, 4}, "half": {3, 4}, "few": {4}}
    assert shared_runs(runs) == (["ours", "theirs", "half", "few"], {4})  # each half of what is shared before it
    del runs["half"]
    assert shared_runs(runs) == (["ours", "theirs"], {1, 2, 3, 4})


def test_references_are_taken_on_the_scenes_and_seeds_that_are_compared():
    """Where methods were run on one scene alone, the ceiling's costs are of that scene too."""
    table = pd.concat(
        [
            rows(("3dgs-clean", "clean", "done", 30.0), *((name, "streak", "done", 20.0) for name in ("3dgs", "ours"))),
            rows(("3dgs-clean", "clean", "done", 10.0), ("3dgs-clean", "clean", "done", 10.0)).assign(scene="pond"),
            rows(("3dgs-clean", "clean", "done", 10.0)).assign(seed=1),
        ],
        ignore_index=True,
    ).assign(train_s=lambda found: found.psnr)
    means = cost_means(table)
    assert means.loc["3dgs-clean", ["psnr", "train_s", "finished", "compared"]].tolist() == [30, 30, 4, 1]
    assert scene_table(table, "yard", "demo", "given-poses").loc["3dgs-clean", ("streak", "psnr")] == 30
    alone = table[table.method == "3dgs-clean"]
    assert cost_means(alone).loc["3dgs-clean", "psnr"] == 15  # where nothing is compared: scenes alike, then seeds


@pytest.mark.parametrize(
    ("pattern", "grade"),
    [("streak-0", "light"), ("raindrop-4", "medium"), ("storm-11", "heavy"), ("captured-0", ""), ("clean", "")],
)
def test_what_no_generator_graded_has_no_grade(pattern, grade):
    assert grade_of(pattern) == grade


def test_tracks_stand_apart():
    many, few = (
        rows(("3dgs", "streak", "done", low), ("ours", "streak", "done", middle), ("3dgs-clean", "clean", "done", 30.0))
        for low, middle in ((20.0, 25.0), (10.0, 28.0))
    )
    few["track"] = "sparse-views"
    table = pd.concat([few, many], ignore_index=True)
    assert scene_keys(table) == [("yard", "demo", "given-poses"), ("yard", "demo", "sparse-views")]
    for track, psnr, gap in (("given-poses", 25, 0.5), ("sparse-views", 28, 0.9)):
        summary = scene_table(table, "yard", "demo", track)["streak"]
        assert summary.loc["ours", "psnr"] == psnr
        assert summary.loc["ours", "gap"] == pytest.approx(gap)
        assert list(summary.finished) == list(summary.planned) == [1] * 3
