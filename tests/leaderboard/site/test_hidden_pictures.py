"""What methods have hidden, beside the rain that was drawn."""

import logging
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from baselines.method import check_hidden
from hydroviews.dataset.variants import open_variant
from leaderboard.gather import collect
from leaderboard.runs.own_files import HIDDEN
from leaderboard.runs.train_and_render import draw_hidden
from leaderboard.site.hidden_pictures import TRUTH, hidden_pictures, true_cover
from leaderboard.site.pictures import RAINY_VIEW, Thumbnails
from leaderboard.site.runs import shown_runs
from leaderboard.site.write import write_site


def shown(tmp_path):
    results = tmp_path / "results"
    thumbnails = Thumbnails(tmp_path / "pictures")
    return hidden_pictures(shown_runs(collect(results), results), tmp_path / "data", thumbnails)


def grey(tmp_path, name):
    with Image.open(tmp_path / "pictures" / name) as picture:
        return np.asarray(picture.convert("L"), float) / 255


def test_a_run_draws_what_its_method_hides_and_pages_show_it_beside_the_rain(evaluated, tmp_path):
    scene = open_variant(tmp_path / "data" / "demo" / "yard", "streak-0")
    [(title, pictures)] = shown(tmp_path).items()
    assert title == "streak-0, seed 0"
    assert list(pictures)[:2] == [RAINY_VIEW, TRUTH]
    train = [view.name for view in scene.train_views]
    first_middle_last = {train[0], train[round(0.5 * (len(train) - 1))], train[-1]}
    assert list(pictures["toy_methods:MeanColour"]) == sorted(first_middle_last)
    assert {tuple(views) for views in pictures.values()} == {tuple(pictures[TRUTH])}
    for view in pictures[TRUTH]:
        assert grey(tmp_path, pictures["toy_methods:MeanColour"][view]).mean() == pytest.approx(0.25, abs=0.01)
        truth = true_cover(tmp_path / "data" / "demo" / "yard" / "streak-0", view)
        assert 0 < truth.mean() < 1
        assert grey(tmp_path, pictures[TRUTH][view]).mean() == pytest.approx(truth.mean(), abs=0.02)
    write_site(collect(tmp_path / "results"), tmp_path / "results", tmp_path / "data")
    [page] = (tmp_path / "results" / "site" / "scenes").iterdir()
    assert "Rain and ignored pixels" in page.read_text()
    assert page.read_text().count(f"<figcaption>{TRUTH}</figcaption>") == len(pictures[TRUTH])


def test_a_damaged_picture_is_left_out_with_a_warning(evaluated, tmp_path, caplog):
    results = tmp_path / "results"
    damaged, *whole = sorted((results / "demo/toy_methods.MeanColour/yard/streak-0/seed-0" / HIDDEN).glob("*.png"))
    damaged.write_bytes(b"")
    (pictures,) = shown(tmp_path).values()
    assert list(pictures["toy_methods:MeanColour"]) == [path.stem for path in whole]
    assert list(pictures[TRUTH]) == [damaged.stem, *(path.stem for path in whole)]  # other methods may have it
    assert write_site(collect(results), results, tmp_path / "data").is_file()
    assert f"{damaged}: not on the pages" in caplog.text
    for path in whole:
        path.write_bytes(path.read_bytes()[:100])
    assert write_site(collect(results), results, tmp_path / "data").is_file()
    assert shown(tmp_path) == {}


def test_rain_of_other_data_is_not_shown(evaluated, tmp_path, caplog):
    shutil.rmtree(tmp_path / "data")
    with caplog.at_level(logging.WARNING):
        (pictures,) = shown(tmp_path).values()
    assert pictures
    assert not {TRUTH, RAINY_VIEW} & set(pictures)
    assert "no rain of yard/streak-0 on the pages" in caplog.text


@pytest.mark.parametrize(
    ("plane", "fault"),
    [
        (np.zeros((4, 5), np.float32), r"float32 \(4, 5\), expected float32 \(4, 6\)"),
        (np.zeros((4, 6)), "float64"),
        (np.full((4, 6), 1.5, np.float32), "expected finite values"),
        (np.full((4, 6), np.nan, np.float32), "nan to nan"),
        ("all", "str"),
    ],
)
def test_what_is_no_plane_of_shares_is_refused(plane, fault):
    with pytest.raises(ValueError, match=fault):
        check_hidden(plane, (4, 6))


def test_a_method_that_does_not_look_for_such_draws_nothing(evaluated, tmp_path):
    silent = SimpleNamespace(hidden=lambda view, size: None)
    draw_hidden(silent, open_variant(tmp_path / "data" / "demo" / "yard", "streak-0"), tmp_path / HIDDEN)
    assert not (tmp_path / HIDDEN).exists()
