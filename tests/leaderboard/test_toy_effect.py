"""An effect of one's own, in one file, goes the whole way without a change elsewhere."""

import json

import pandas as pd
import pytest

from hydroviews.dataset.card.contact_sheet import write_sheets
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.statistics import read_statistics
from hydroviews.dataset.suites import read_suite
from hydroviews.errors import InputError
from hydroviews.rain.registry import choose_patterns, find_effect
from hydroviews.scene.images import read_image, write_png
from leaderboard.evaluate import evaluate
from leaderboard.tables.dataframes import scene_table
from leaderboard.tables.markdown import to_markdown

ASH = "toy_effect.Ash"  # in names of folders, where a colon may not stand


@pytest.mark.usefixtures("toys", "trained_here")
def test_from_build_to_table(tmp_path, request_of):
    evaluate(request_of(patterns=("toy_effect:Ash-0", "toy_effect:Ash-2")))
    data = tmp_path / "data" / "demo"
    folder = data / "yard"

    facts = json.loads((folder / f"{ASH}-2" / "pattern.json").read_text())
    assert (facts["effect"], facts["grade"], facts["parameters"]["cover"]) == (ASH, "heavy", 0.2)
    assert verify(data, every_view=True) == []
    rows = read_statistics(folder / f"{ASH}-2" / "statistics.csv")
    assert rows.water.mean() == pytest.approx(0.2, abs=0.02)
    assert rows[["mist", "streaks", "angle", "seed_density"]].isna().all(axis=None)
    assert f"* **{ASH}-2**: ash over 20% of the picture, of grey 0." in (folder / "README.md").read_text()
    assert all(read_image(path).std() > 0 for path in write_sheets(folder))

    board = pd.read_csv(tmp_path / "results" / "leaderboard.csv")
    assert sorted(set(board.effect)) == ["clean", ASH]
    assert set(board.drawing_code[board.pattern == f"{ASH}-2"]) == {facts["drawing_code"]}
    assert facts["drawing_code"] not in set(board.drawing_code[board.effect == "clean"])
    assert ASH in to_markdown(scene_table(board, "yard", "demo", "given-poses"))

    image = folder / f"{ASH}-0" / "images" / "view-00.png"
    write_png(image, read_image(image) * 0.5)
    assert any("differs by" in problem for problem in verify(data))


def test_an_effect_of_ones_own_is_named_by_patterns_and_suites(tmp_path):
    assert [pattern.name for pattern in choose_patterns((), (0, 1), ["toy_effect:Ash"])] == [f"{ASH}-0", f"{ASH}-1"]
    assert choose_patterns([f"{ASH}-1"], ()) == choose_patterns(["toy_effect:Ash-1"], ())
    suite = tmp_path / "mine.toml"
    suite.write_text('[scenes]\nyard = ["toy_effect:Ash"]')
    assert read_suite(str(suite)).scenes == {"yard": ("toy_effect:Ash",)}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("hail", "no such effect\n.*\n.*raindrop.*streak.*, or package.module:Class"),
        ("toy_effect:Hail", "cannot import toy_effect:Hail\n.*AttributeError"),
        ("no_such_module:Hail", "cannot import no_such_module:Hail\n.*ModuleNotFoundError"),
        ("toy_effect:AshPattern", "not an effect"),
        (":Hail", "no such effect"),
    ],
)
def test_what_is_no_effect_is_told(name, message):
    with pytest.raises(InputError, match=message):
        find_effect(name)
