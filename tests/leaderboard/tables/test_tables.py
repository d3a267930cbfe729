"""Means over the runs that all share, the share of the gap, and who lacks runs; of one scene."""

import pandas as pd
import pytest
from made_up_board import run_row

from hydroviews.metrics import find_metrics
from leaderboard.tables.dataframes import cost_means, grade_of, scene_keys, scene_table, share_of_gap
from leaderboard.tables.markdown import to_markdown
from leaderboard.tables.means import places, shared_runs


def runs(method: str, *scores: float | None, pattern: str = "streak-0", **changes) -> pd.DataFrame:
    """A method's runs of seeds from 0 on by their PSNR; one without has failed."""
    own = [{"seed": i, "psnr": psnr, "status": "failed" if psnr is None else "done"} for i, psnr in enumerate(scores)]
    return pd.DataFrame([run_row(method, "yard", pattern, ssim=0.5) | one | changes for one in own])


def clean(*scores: float, **changes) -> pd.DataFrame:
    return runs("3dgs-clean", *scores, pattern="clean", **changes)


def table(*parts: pd.DataFrame) -> pd.DataFrame:
    return pd.concat(parts, ignore_index=True)


def board(*parts: pd.DataFrame) -> pd.DataFrame:
    return scene_table(table(*parts), "yard", "demo", "given-poses")


def test_means_share_of_gap_and_order():
    drops = runs("3dgs", 22.0, pattern="raindrop-0")
    found = board(runs("ours", 24.0, 26.0), runs("3dgs", 20.0, 20.0), drops, clean(30.0, 30.0))
    assert list(found.index) == ["3dgs-clean", "3dgs", "ours"]
    assert found.streak.psnr.to_dict() == {"3dgs-clean": 30, "3dgs": 20, "ours": 25}
    assert found.streak.gap.to_dict() == pytest.approx({"3dgs-clean": 1, "3dgs": 0, "ours": 0.5})
    assert found.raindrop.psnr["3dgs-clean"] == 30  # the ceiling stands under every effect


def test_the_gap_is_taken_on_the_runs_that_have_both_references():
    ours = runs("3dgs", 26.0), runs("3dgs", 14.0, pattern="streak-2"), runs("ours", 25.0), clean(30.0)
    found = board(*ours, runs("theirs", 29.0, data_sha256="an older build of the scene")).streak
    assert found.gap["ours"] == pytest.approx(-0.25)
    assert pd.isna(found.gap["theirs"])
    assert found.gap["3dgs-clean"] == 1


def test_the_share_of_the_gap_is_of_the_means_beside_it_where_patterns_have_unlike_numbers_of_seeds():
    """In three seeds of one pattern half the gap is won, in one of another a tenth."""
    other = [runs(name, psnr, pattern="streak-1") for name, psnr in (("3dgs", 20.0), ("ours", 21.0))]
    more = runs("3dgs", 10.0, 10.0, 10.0), runs("ours", 20.0, 20.0, 20.0), clean(30.0, 30.0, 30.0)
    found = board(*more, *other).streak
    assert (found.psnr["3dgs"], found.psnr["ours"]) == (15, 20.5)
    assert found.gap["ours"] == pytest.approx((20.5 - 15) / (30 - 15))


@pytest.mark.parametrize("lacking", ["3dgs", "3dgs-clean", "ours"])
def test_no_share_is_told_of_runs_that_lack_a_score(lacking):
    """Means of three methods over other runs would be of no gap at all."""
    found = table(runs("3dgs", 20.0, 10.0), runs("ours", 25.0, 11.0), clean(30.0, 30.0))
    assert share_of_gap(found, "ours") == pytest.approx((18 - 15) / (30 - 15))
    found.loc[found.index[found.method == lacking][0], "psnr"] = float("nan")
    assert pd.isna(share_of_gap(found, "ours"))


def test_failed_runs_are_counted_and_left_out_of_the_mean():
    found = board(runs("ours", 24.0, None), runs("theirs", None), clean(30.0))
    ours = found.streak.loc["ours"]
    assert (ours.psnr, ours.finished, ours.planned) == (24, 1, 2)
    text = to_markdown(found)
    assert "| ours | <u>**24.00**</u> | <u>**0.5000**</u> |  |  |  |  | <u>1/2</u> |" in text
    assert "| theirs |  |  |  |  |  |  | <u>0/2</u> |" in text
    assert "Means over 1 of 2 runs, which all the others have. Without a finished run: theirs." in text


def test_where_a_run_lacks_a_number_its_mean_is_not_told():
    partial = runs("ours", 24.0, None).replace({"status": {"failed": "partial"}})
    assert pd.isna(board(partial).streak.psnr["ours"])


def test_means_are_of_shared_runs_and_who_lacks_runs_is_underlined_and_not_the_best():
    found = board(runs("ours", 29.0, None), runs("theirs", 24.0, 10.0), runs("thirds", 23.0, 40.0))
    assert dict(found.streak.psnr) == {"ours": 29, "theirs": 24, "thirds": 23}  # seed 1 counts for nobody
    assert places(found.streak, find_metrics()[0]) == {"ours": 3, "theirs": 1, "thirds": 2}
    text = to_markdown(found)
    assert "| ours | <u>29.00</u> |" in text
    assert "| theirs | **24.00** |" in text
    assert "Means over 1 of 2 runs, which all of them have." in text


def test_a_method_that_shares_no_run_is_told_and_empties_nothing():
    found = board(runs("ours", 29.0, 27.0), runs("theirs", 24.0, 20.0), runs("alone", 9.0, data_sha256="older"))
    assert found.streak.psnr.dropna().to_dict() == {"ours": 28, "theirs": 22}
    told = "Means over 2 of 2 runs, which all of them have, but alone, which shares fewer than half."
    assert told in to_markdown(found)


def test_a_method_that_lacks_most_runs_leaves_the_others_theirs():
    finished = {"ours": {1, 2, 3, 4, 5}, "theirs": {1, 2, 3, 4}, "half": {3, 4}, "few": {4}}
    assert shared_runs(finished) == (["ours", "theirs", "half", "few"], {4})  # each half of what is shared before it
    del finished["half"]
    assert shared_runs(finished) == (["ours", "theirs"], {1, 2, 3, 4})


def test_references_are_taken_on_the_scenes_and_seeds_that_are_compared():
    """Where methods were run on one scene alone, the ceiling's costs are of that scene too."""
    references = clean(30.0, 10.0), clean(10.0, 10.0, scene="pond")
    found = table(*references, runs("3dgs", 20.0), runs("ours", 20.0)).assign(train_s=lambda rows: rows.psnr)
    means = cost_means(found)
    assert means.loc["3dgs-clean", ["psnr", "train_s", "finished", "compared"]].tolist() == [30, 30, 4, 1]
    assert board(found).streak.psnr["3dgs-clean"] == 30
    alone = found[found.method == "3dgs-clean"]
    assert cost_means(alone).psnr["3dgs-clean"] == 15  # where nothing is compared: scenes alike, then seeds


@pytest.mark.parametrize(
    ("pattern", "grade"),
    [("streak-0", "light"), ("raindrop-4", "medium"), ("storm-11", "heavy"), ("captured-0", ""), ("clean", "")],
)
def test_what_no_generator_graded_has_no_grade(pattern, grade):
    assert grade_of(pattern) == grade


def test_tracks_stand_apart():
    few = table(runs("3dgs", 10.0), runs("ours", 28.0), clean(30.0)).assign(track="sparse-views")
    both = table(few, runs("3dgs", 20.0), runs("ours", 25.0), clean(30.0))
    assert scene_keys(both) == [("yard", "demo", "given-poses"), ("yard", "demo", "sparse-views")]
    for track, psnr, gap in (("given-poses", 25, 0.5), ("sparse-views", 28, 0.9)):
        summary = scene_table(both, "yard", "demo", track).streak
        assert (summary.psnr["ours"], summary.gap["ours"]) == (psnr, pytest.approx(gap))
        assert list(summary.finished) == list(summary.planned) == [1] * 3
