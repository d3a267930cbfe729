"""Boards of known scores: what is compared, ranked, tied and missing; every number against one by pandas."""

import itertools
import shutil

import numpy as np
import pandas as pd
import pytest
from made_up_board import run_row

from hydroviews.errors import InputError
from leaderboard.__main__ import compare_command, table_command
from leaderboard.gather import VIEW_KEYS
from leaderboard.records import Record, run_folder, write_record
from leaderboard.tables.comparison import compare, in_words, rank_text
from leaderboard.tables.markdown import SHARED

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
        failed = (method, scene, pattern, seed) in missing
        runs.append(run_row(method, scene, pattern, seed, status="failed" if failed else "done"))
        luck = rng.normal(0, LUCK)
        for view in [] if failed else range(n_views):
            psnr = difficulty[scene, view] + methods[method] + luck + rng.normal(0, LUCK)
            views.append(runs[-1] | {"view": f"v{view}", "psnr": psnr, "lpips_alex": 1 / psnr})
    return pd.DataFrame(runs), pd.DataFrame(views, columns=[*VIEW_KEYS, "view", "psnr", "lpips_alex"])


@pytest.fixture
def results(tmp_path):
    """A results folder with two methods on a test scene, a development scene and one of somebody's own."""
    for method, scene, pattern in itertools.product(("a", "b"), ("room", "courtyard", "mine"), ("streak-0", "clean")):
        add_run(tmp_path, method, scene, pattern)
    return tmp_path


def add_run(results, method, scene, pattern):
    folder = run_folder(results, "demo", method, scene, pattern, 0, "given-poses")
    folder.mkdir(parents=True)
    scores = {"psnr": 20.0 + (method == "a"), "ssim": 0.5, "lpips_alex": 0.2, "lpips_vgg": 0.3}
    views = pd.DataFrame([{"view": f"0{i}"} | scores for i in range(3)])
    views.to_csv(folder / "per_view.csv", index=False)
    names = {"method": method, "scene": scene, "effect": pattern.partition("-")[0], "pattern": pattern, "seed": 0}
    told = {"track": "given-poses", "status": "done", "reason": "", "profile": "demo", "data_sha256": scene}
    write_record(folder, Record(**names, **told, n_train=7, n_test=3, width=1, height=1, scores=scores))


def test_suites_stand_apart_and_one_can_be_asked_for(results, capsys):
    compare_command(results=results)
    printed = capsys.readouterr().out
    titles = [f"{suite}, demo, given-poses" for suite in ("Suite test", "Suite development", "Other scenes")]
    assert [printed.count(title) for title in titles] == [1, 1, 1]
    assert sorted(titles, key=printed.index) == titles
    assert printed.count("Means over the 1 runs that all of them have, on 1 scene, 3 views.") == 3
    assert "| a | 21.00 [21.00, 21.00] | 1/1 |" in printed
    compare_command(suite="development", patterns=("streak-0",), results=results)
    assert "Suite test" not in capsys.readouterr().out
    table_command(results, "test")
    printed = capsys.readouterr().out
    assert "room (demo, given-poses, test suite)" in printed
    assert "courtyard" not in printed


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"suite": "testing"}, r"no such suite[\s\S]*did you mean test"),
        ({"patterns": ("storm-0",)}, "no such run"),
        ({"profile": "paper"}, "no such run"),
    ],
)
def test_what_is_not_there_cannot_be_compared(results, options, message):
    with pytest.raises(InputError, match=message):
        compare_command(results=results, **options)


def test_a_suite_that_cannot_be_compared_does_not_hold_up_the_others(results, capsys):
    add_run(results, "c", "mine", "streak-0")
    for method in ("a", "b"):
        shutil.rmtree(results / "demo" / method / "courtyard")
    add_run(results, "3dgs-clean", "courtyard", "clean")  # a ceiling alone
    compare_command(("a", "c"), results=results)
    printed = capsys.readouterr().out
    assert "Suite test, demo, given-poses\n\nMETHOD=c: no such method with runs on rainy views" in printed
    assert "Suite development, demo, given-poses\n\nMETHOD=a: no such method" in printed
    assert "Means over the 1 runs that all of them have, on 1 scene, 3 views." in printed.split("Other scenes")[1]
    compare_command(results=results)
    assert "Suite development, demo, given-poses\n\nno run that all methods" in capsys.readouterr().out
    with pytest.raises(InputError, match="no such method"):
        compare_command(("a", "c"), suite="test", results=results)
    assert capsys.readouterr().out == ""


def test_a_method_that_lacks_most_runs_is_not_compared_and_named(results, capsys):
    for method, pattern in (*itertools.product(("a", "b"), ("streak-1", "streak-2")), ("few", "streak-1")):
        add_run(results, method, "room", pattern)
    compare_command(suite="test", results=results)
    printed = capsys.readouterr().out
    assert "Means over the 3 runs that all of them have, on 1 scene, 9 views." in printed
    assert "Not compared, since fewer than half of the runs are shared: few." in printed
    assert "| few |" not in printed.split(SHARED)[0]
    compare_command(("a", "few"), suite="test", results=results)  # what is asked for by name is compared
    printed = capsys.readouterr().out
    assert "Means over the 1 runs that all of them have" in printed
    assert "Not compared" not in printed


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
    assert (found.n_scenes, found.n_runs, found.n_views, found.seeds) == (3, 18, 72, 1)
    text = in_words(found, "suite test")
    assert text.startswith("suite test\n\n| rank | method | PSNR [95 %] | runs |")
    told = "Seeds per pattern that would separate the first two methods on these scenes: 1.\n"
    assert "| tie |" in text
    assert f"on 3 scenes, 72 views. {told}" in text


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
    assert dict(found["rank"]) == {"ours": 3, "theirs": 1, "3dgs": 1}  # these two as if it were not there
    assert found.loc["ours", ["finished", "planned"]].tolist() == [16, 18]
    assert "| 16/18 |" in in_words(compare(runs, views, "psnr"), "")


def test_a_method_without_any_run_is_listed_last_and_empties_nothing():
    lost = list(itertools.product(["theirs"], SCENES, PATTERNS, [0, 1]))
    found = compare(*board(missing=lost), "psnr")
    assert list(found.methods.method)[-1] == "theirs"
    assert (found.methods["mean"].isna().sum(), found.n_runs) == (1, 18)
    assert [rank_text(rank) for rank in found.methods["rank"]] == ["1", "2", ""]
    for told in ("|  | theirs |  | 0/18 |", "Means over the 18 runs that all with a rank have"):
        assert told in in_words(found, "")


def test_runs_on_other_data_and_views_without_a_finite_score_do_not_count():
    runs, views = board()
    views.loc[views.index[:4], "psnr"] = [1.0, np.inf, 1.0, 1.0]
    assert compare(runs, views, "psnr").n_runs == 17
    for table in (runs, views):
        table.loc[(table.method == "ours") & (table.scene == "pond"), "data_sha256"] = "of an older build"
    assert compare(runs, views, "psnr").n_runs == 11


@pytest.mark.parametrize(
    "change",
    [
        lambda views, ours: views.assign(view=views.view.mask(ours & (views.view == "v3"), "v9")),  # one other
        lambda views, ours: views[~(ours & (views.view == "v3"))],  # one less
        lambda views, ours: views[~(ours & (views.view == "v3") & (views.seed == 0))],  # in some of its runs
    ],
)
def test_runs_on_the_same_data_with_other_views_are_refused(change):
    runs, views = board()
    views = change(views, (views.method == "ours") & (views.scene == "pond"))
    with pytest.raises(InputError, match="pond: runs on the same data have other views"):
        compare(runs, views, "psnr")


def test_seeds_are_those_that_tell_the_first_two_apart():
    """By rank: the first two by name are so far apart that one seed does."""
    assert compare(*board({"3dgs": -5.0, "ours": 0.05, "theirs": 0.0}), "psnr").seeds > 1


def test_what_was_submitted_stands_apart_from_a_method_of_the_same_name():
    runs, views = board(methods={"a": 1.0})
    both = (pd.concat([table, table.assign(submitted_by="Ada")]) for table in (runs, views))
    found = compare(*both, "psnr")
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
    halves = ("ours", 0), ("theirs", 1)
    half = [(method, *place, seed) for method, seed in halves for place in itertools.product(SCENES, PATTERNS)]
    with pytest.raises(InputError, match=r"no run that all methods have finished[\s\S]*3dgs 18, ours 9, theirs 9"):
        compare(*board(missing=half), "psnr", ["3dgs", "ours", "theirs"])
    found = compare(*board(missing=half), "psnr")
    assert (set(found.methods.method), found.apart) == ({"3dgs", "ours"}, ["theirs"])


def test_a_gain_that_one_scene_alone_shows_is_not_significant():
    """All runs are better, which ranks say; but the interval over scenes holds 0."""
    runs, views = board({"ours": 0.0, "3dgs": 0.0})
    ours, gains = views.method == "ours", views.scene.map({"room": 5.0, "street": 0.2, "pond": 0.2})
    views.loc[ours, "psnr"] = views.psnr[views.method == "3dgs"].to_numpy() + gains[ours].to_numpy()
    pair = compare(runs, views, "psnr").pairs.iloc[0]
    assert pair.p_holm < 0.05
    assert pair.low < 0 < pair.high
    assert not pair.significant
