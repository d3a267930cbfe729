"""Boards of known scores: what is compared, ranked, tied and missing; every number against one by pandas."""

import itertools

import numpy as np
import pandas as pd
import pytest

from hydroviews.errors import InputError
from leaderboard.comparison import compare, in_words
from leaderboard.gather import VIEW_KEYS
from leaderboard.records import columns

SHIFTS = {"ours": 2.0, "theirs": 0.02, "3dgs": 0.0}
PATTERNS = ("raindrop-1", "streak-1", "storm-1")
SCENES = ("room", "street", "pond")
LUCK = 0.1


def board(methods=SHIFTS, seeds=(0, 1), n_views=4, missing=()):
    """Runs and views; a score is the view's, the method's shift, and the run's and the render's luck."""
    rng = np.random.default_rng(0)
    difficulty = {(scene, view): rng.normal(20, 3) for scene in SCENES for view in range(n_views)}
    runs, views = [], []
    for method, scene, pattern, seed in itertools.product(methods, SCENES, PATTERNS, seeds):
        effect = pattern.partition("-")[0]
        keys = {"method": method, "submitted_by": "", "scene": scene, "effect": effect, "pattern": pattern}
        keys |= {"seed": seed, "profile": "demo", "track": "given-poses", "data_sha256": scene + pattern}
        failed = (method, scene, pattern, seed) in missing
        runs.append(dict.fromkeys(columns()) | keys | {"status": "failed" if failed else "done"})
        luck = rng.normal(0, LUCK)
        for view in [] if failed else range(n_views):
            psnr = difficulty[scene, view] + methods[method] + luck + rng.normal(0, LUCK)
            views.append(keys | {"view": f"v{view}", "psnr": psnr, "lpips_alex": 1 / psnr})
    return pd.DataFrame(runs), pd.DataFrame(views, columns=[*VIEW_KEYS, "view", "psnr", "lpips_alex"])


def by_pandas(views: pd.DataFrame, metric: str = "psnr") -> dict[str, float]:
    """Means of means of means, written down another way."""
    means = views.groupby(["method", "scene", "pattern", "seed"])[metric].mean()
    for keys in (["method", "scene", "pattern"], ["method", "scene"], ["method"]):
        means = means.groupby(keys).mean()
    return dict(means)


def test_means_ranks_and_ties():
    runs, views = board()
    found = compare(runs, views, "psnr")
    expected = by_pandas(views)
    assert dict(zip(found.methods.method, found.methods["mean"], strict=True)) == pytest.approx(expected)
    assert found.methods.method[0] == "ours"
    assert list(found.methods["rank"]) == [1, 2, 2]  # theirs and 3dgs cannot be told apart
    assert list(found.pairs.significant) == [True, True, False]
    assert found.pairs.difference[0] == pytest.approx(expected["ours"] - expected[found.pairs.second[0]])
    assert (found.n_scenes, found.n_runs, found.n_views) == (3, 18, 72)
    assert found.seeds == 1
    text = in_words(found, "suite test")
    assert text.startswith("suite test\n\n| rank | method | PSNR [95 %] | runs |")
    assert "| tie |" in text
    assert "on 3 scenes, 72 views. Seeds a pattern that would tell the first two apart on these scenes: 1.\n" in text


def test_of_a_metric_where_low_is_good_the_low_one_is_first():
    found = compare(*board(), "lpips_alex")
    assert found.methods.method[0] == "ours"
    assert found.pairs.high[0] < 0
    assert found.pairs.significant[0]


def test_means_are_of_runs_that_all_have_and_who_finished_fewer_ranks_below():
    lost = [("ours", "room", "streak-1", 0), ("ours", "pond", "storm-1", 1)]
    runs, views = board(missing=lost)
    found = compare(runs, views, "psnr").methods.set_index("method")
    keys = zip(views.scene, views.pattern, views.seed, strict=True)
    common = views[[key not in {run[1:] for run in lost} for key in keys]]
    assert dict(found["mean"]) == pytest.approx(by_pandas(common))
    assert found.loc["ours", "mean"] == found["mean"].max()
    assert found.index[-1] == "ours"
    assert found.loc["ours", "rank"] == 3
    assert (found.loc["ours", "finished"], found.loc["ours", "planned"]) == (16, 18)
    assert "| 16/18 |" in in_words(compare(runs, views, "psnr"), "")


def test_a_method_without_any_run_is_listed_last_and_empties_nothing():
    lost = list(itertools.product(["theirs"], SCENES, PATTERNS, [0, 1]))
    found = compare(*board(missing=lost), "psnr")
    assert list(found.methods.method)[-1] == "theirs"
    assert found.methods["mean"].isna().sum() == 1
    assert found.n_runs == 18
    assert "| 3 | theirs |  | 0/18 |" in in_words(found, "")


def test_runs_on_other_data_and_views_without_a_finite_score_do_not_count():
    runs, views = board()
    views.loc[views.index[:4], "psnr"] = [1.0, np.inf, 1.0, 1.0]
    assert compare(runs, views, "psnr").n_runs == 17
    old = (views.method == "ours") & (views.scene == "pond")
    views.loc[old, "data_sha256"] = "of an older build"
    assert compare(runs, views, "psnr").n_runs == 11


def test_methods_that_are_named_are_compared_alone():
    found = compare(*board(), "psnr", ["3dgs", "ours"])
    assert list(found.methods.method) == ["ours", "3dgs"]
    assert len(found.pairs) == 1
    assert len(compare(*board(), "psnr", ["ours"]).pairs) == 0


def test_with_one_seed_nothing_is_said_of_seeds():
    found = compare(*board(seeds=(0,)), "psnr")
    assert "is known from two seeds on" in in_words(found, "")


def test_what_was_submitted_stands_apart_from_a_method_of_the_same_name():
    runs, views = board(methods={"a": 1.0})
    theirs = [table.assign(submitted_by="Ada") for table in (runs, views)]
    found = compare(*(pd.concat(pair) for pair in zip((runs, views), theirs, strict=True)), "psnr")
    assert set(found.methods.method) == {"a", "a (submitted)"}
    assert np.isinf(found.seeds)
    assert "The first two are equal" in in_words(found, "")


@pytest.mark.parametrize(
    ("metric", "methods", "message"),
    [("psnrr", (), "did you mean psnr"), ("psnr", ["nerf"], "no such method"), ("ssim", (), "no run that all")],
)
def test_bad_names_and_nothing_to_compare(metric, methods, message):
    runs, views = board()
    with pytest.raises(InputError, match=message):
        compare(runs, views.assign(ssim=np.nan), metric, methods)


def test_methods_without_a_common_run_are_named_with_what_they_have():
    half = [("ours", scene, pattern, 0) for scene in SCENES for pattern in PATTERNS]
    half += [("theirs", scene, pattern, 1) for scene in SCENES for pattern in PATTERNS]
    with pytest.raises(InputError, match=r"no run that all methods have finished[\s\S]*ours 9, theirs 9"):
        compare(*board(missing=half), "psnr")
