"""Rankings: means over the scenes that a method has, gains in pairs of runs, intervals from four scenes on."""

import math

import pandas as pd
import pytest
from made_up_board import run_row

from leaderboard.tables.rankings import rankings
from leaderboard.tables.statistics import LEAST_SCENES

SCENES = ("market", "ngp_fox", "pond", "room", "street")
HARD = dict(zip(SCENES, (20.0, 25.0, 21.0, 27.0, 27.5), strict=True))  # PSNR of the floor


def run(method, scene, psnr, pattern="raindrop-1", seed=0, **changes):
    numbers = {"psnr": psnr, "ssim": psnr / 40, "lpips_alex": 1 / psnr, "lpips_vgg": 2 / psnr}
    return run_row(method, scene, pattern, seed, train_s=30.0, before_s=2.0, **numbers) | changes


def table(*runs):
    return pd.DataFrame([row for rows in runs for row in (rows if isinstance(rows, list) else [rows])])


def floor(scenes=SCENES, **changes):
    return [run("3dgs", scene, HARD[scene], **changes) for scene in scenes]


def above(method, gains, **changes):
    return [run(method, scene, HARD[scene] + gain, **changes) for scene, gain in gains.items()]


ALL = dict(zip(SCENES, (3.0, 4.0, 3.5, 2.5, 3.0), strict=True))


def by_name(ranking):
    return {one.method: one for one in ranking.methods}


def test_methods_are_ranked_by_their_gain_on_the_scenes_that_they_have():
    """A method that ran on easy scenes alone has the best mean, and is not the first."""
    easy = above("easy", {"room": 2.0, "street": 2.0})
    [found] = rankings(table(floor(), above("ours", ALL), easy, above("worse", dict.fromkeys(SCENES, -1.0))))
    assert [(one.method, one.rank) for one in found.methods] == [("ours", 1), ("easy", 2), ("3dgs", 3), ("worse", 4)]
    rows = by_name(found)
    assert rows["easy"].scores["psnr"] > rows["ours"].scores["psnr"] == pytest.approx(24.1 + 3.2)
    assert (rows["easy"].gain, rows["ours"].seconds) == (pytest.approx(2), 32)
    assert (rows["easy"].scenes, rows["ours"].scenes) == (("room", "street"), SCENES)
    assert found.best["psnr"] == rows["ours"].scores["psnr"]  # of the methods with all scenes
    assert found.best["lpips_alex"] == rows["ours"].scores["lpips_alex"]


@pytest.mark.parametrize("count", [LEAST_SCENES - 1, LEAST_SCENES])
def test_there_is_no_interval_below_four_scenes(count):
    scenes = SCENES[:count]
    [found] = rankings(table(floor(scenes), above("ours", {scene: ALL[scene] for scene in scenes})))
    one = by_name(found)["ours"]
    assert one.gain == pytest.approx(sum(ALL[scene] for scene in scenes) / count)
    assert math.isnan(one.low) == math.isnan(one.high) == (count < LEAST_SCENES)
    assert count < LEAST_SCENES or one.low < one.gain < one.high


def test_seeds_count_alike_and_are_paired():
    """The gain of a method with one seed is over the floor's run with that seed."""
    rows = table(floor(seed=0), floor(seed=1), run("ours", "pond", 30.0, seed=1))
    rows.loc[(rows.method == "3dgs") & (rows.seed == 1), "psnr"] += 1
    found = by_name(rankings(rows)[0])
    assert (found["3dgs"].scores["psnr"], found["3dgs"].runs) == (pytest.approx(24.1 + 0.5), 10)
    assert found["ours"].gain == pytest.approx(30 - HARD["pond"] - 1)


def test_a_run_on_other_data_is_no_pair():
    [found] = rankings(table(floor(), above("ours", ALL, data_sha256="older")))
    assert math.isnan(by_name(found)["ours"].gain)
    assert [one.method for one in found.methods] == ["3dgs", "ours"]


def test_references_have_no_rank_and_the_scenes_and_seeds_of_the_others():
    clean = [run("3dgs-clean", scene, 31.0, "clean", seed) for scene in (*SCENES, "attic") for seed in (0, 1)]
    [found] = rankings(table(clean, floor(("pond", "room"))))
    first = found.methods[0]
    assert (first.method, first.rank, first.scenes, first.runs) == ("3dgs-clean", None, ("pond", "room"), 2)
    assert first.gain == pytest.approx(31 - (HARD["pond"] + HARD["room"]) / 2)
    assert found.best["psnr"] == pytest.approx(24)


def test_nobody_without_a_finished_run_is_listed():
    [found] = rankings(table(floor(), above("ours", ALL, status="failed")))
    assert [one.method for one in found.methods] == ["3dgs"]


@pytest.mark.parametrize(("difference", "tied"), [((0.1, -0.1, 0.1, -0.1, 0.05), True), ((1.0,) * 5, False)])
def test_a_tie_is_marked_where_the_difference_to_the_row_above_may_be_none(difference, tied):
    better = {scene: ALL[scene] + more for scene, more in zip(SCENES, difference, strict=True)}
    [found] = rankings(table(floor(), above("better", better), above("ours", ALL)))
    assert [(one.method, one.tied) for one in found.methods] == [("better", False), ("ours", tied), ("3dgs", False)]


def test_medium_rain_comes_first_and_then_what_most_ran_under():
    runs = [floor(pattern=name) for name in ("raindrop-0", "haze-1", "streak-1")]
    found = rankings(table(*runs, above("ours", ALL, pattern="streak-1")))
    assert [one.title for one in found] == ["streak, medium", "haze, medium", "raindrop, light"]


def test_a_number_that_a_run_lacks_is_missing():
    rows = table(floor(), above("ours", ALL))
    rows.loc[(rows.method == "ours") & (rows.scene == "pond"), ["ssim", "train_s"]] = None
    one = by_name(rankings(rows)[0])["ours"]
    assert math.isnan(one.scores["ssim"])
    assert math.isnan(one.seconds)
    assert one.rank == 1
