from pathlib import Path

import pandas as pd
import pytest
from synthetic import capture_in

from hydroviews.dataset.build import build
from hydroviews.dataset.card.markdown import describe_rain
from hydroviews.dataset.manifest import built_scenes, data_hash, read_manifest
from hydroviews.dataset.statistics import read_statistics
from hydroviews.dataset.verify import verify
from hydroviews.errors import InputError
from hydroviews.formats.markdown import markdown_table
from hydroviews.rain.patterns import Pattern
from leaderboard.__main__ import card_command
from leaderboard.severity import record_losses, rewrite_card

STREAKS = (Pattern("streak", 0), Pattern("streak", 2))


@pytest.fixture
def built(tmp_path) -> Path:
    """A capture that says where it comes from, built with two kinds of streaks."""
    capture = tmp_path / "capture" / "yard"
    scene = capture_in(capture)
    (capture / "SOURCE.md").write_text("# From a garden\nLicence: CC-BY\n")
    return build(scene, tmp_path / "data", patterns=STREAKS, seed=5, source=str(capture))


def results_in(folder: Path, built: Path, **changes) -> Path:
    """A results folder with one run of each reference on each variant, two tracks, two seeds."""
    rows = []
    for track, penalty in (("given-poses", 0), ("sparse-views", 4)):
        for seed in (0, 1):
            for method, pattern, psnr in (
                ("3dgs-clean", "clean", 26 + seed),
                ("3dgs", "streak-0", 24.5),
                ("3dgs", "streak-2", 17.25),
                ("ours", "streak-2", 25),
            ):
                facts = {"scene": built.name, "profile": "demo", "track": track, "seed": seed, "status": "done"}
                numbers = {"psnr": psnr - penalty, "data_sha256": data_hash(built.parent, built.name, pattern)}
                rows.append({**facts, "method": method, "pattern": pattern, **numbers, **changes})
    folder.mkdir(parents=True)
    pd.DataFrame(rows).to_csv(folder / "leaderboard.csv", index=False)
    return folder


def test_the_card_says_what_the_files_say(built):
    card = (built / "README.md").read_text()
    assert card.startswith("# yard\n")
    assert "| views | 9 of 48x36 pixels |" in card
    assert "| split | 7 to train on, 2 held out |" in card
    assert "sparse-views, with 3 of the training views" in card
    table = read_statistics(built / "statistics.csv").set_index("pattern")
    for name, grade in (("streak-0", "light"), ("streak-2", "heavy")):
        assert f"| {name} | {grade} | {table.loc[name].psnr_mean:.1f} dB (" in card
        assert f"* **{name}**: noise level n = " in card
    assert "> Licence: CC-BY" in card
    assert (built / "licence" / "SOURCE.md").read_text() == "# From a garden\nLicence: CC-BY\n"
    assert "build --scene path/to/yard --seed 5 --patterns streak-0 streak-2\n" in card
    assert str(built.parents[1]) not in card
    assert "What it costs" not in card
    assert "--lens-renderer" not in card
    assert verify(built.parent) == []


def test_the_card_names_a_technique_that_is_not_the_default(tmp_path):
    folder = build(capture_in(tmp_path / "yard"), tmp_path / "data", patterns=[], lens_renderer="aperture")
    assert "--seed 0" in (folder / "README.md").read_text()
    assert "--lens-renderer aperture" in (folder / "README.md").read_text()


def test_the_same_scene_gives_the_same_card_elsewhere(built, tmp_path):
    scene = capture_in(tmp_path / "other" / "yard")
    again = build(scene, tmp_path / "again", patterns=STREAKS, seed=5, source=str(tmp_path / "other" / "yard"))
    card, other = ((folder / "README.md").read_text() for folder in (built, again))
    assert "licence is unknown" in other
    assert card.partition("From `licence")[0] == other.partition("The photographs' licence")[0]
    rewrite_card(built)
    assert (built / "README.md").read_text() == card


def test_losses_are_those_of_the_runs_and_stay(built, tmp_path):
    record_losses(built, results_in(tmp_path / "results", built))
    card = (built / "README.md").read_text()
    assert "| streak-0 | light | given-poses | 26.50 dB | 24.50 dB | 2.00 dB | 2 |" in card
    assert "| streak-2 | heavy | sparse-views | 22.50 dB | 13.25 dB | 9.25 dB | 2 |" in card
    assert verify(built.parent) == []
    rewrite_card(built)
    assert (built / "README.md").read_text() == card
    (built / "statistics.csv").unlink()  # a repair by the same build
    scene = capture_in(tmp_path / "capture" / "yard")
    build(scene, built.parent, patterns=STREAKS, seed=5, source=str(tmp_path / "capture" / "yard"))
    assert (built / "README.md").read_text() == card
    assert verify(built.parent) == []


@pytest.mark.parametrize("change", [{"data_sha256": "of another build"}, {"status": "failed"}, {"scene": "other"}])
def test_runs_on_other_data_do_not_count(built, tmp_path, change):
    results = results_in(tmp_path / "results", built, **change)
    with pytest.raises(InputError, match="no pair of finished runs"):
        record_losses(built, results)
    assert not (built / "losses.csv").exists()


def test_no_leaderboard(built, tmp_path):
    with pytest.raises(InputError, match="no leaderboard"):
        record_losses(built, tmp_path)
    for content in ("", "method,scene\n3dgs,yard\n"):
        (tmp_path / "leaderboard.csv").write_text(content)
        with pytest.raises(InputError, match="no leaderboard"):
            record_losses(built, tmp_path)


def test_a_scene_without_runs_does_not_hold_up_the_others(built, tmp_path, capsys):
    build(capture_in(tmp_path / "capture" / "another"), built.parent, patterns=STREAKS)
    with pytest.raises(InputError, match="no pair of finished runs of 3dgs-clean and 3dgs on another"):
        card_command(built.parent, results=results_in(tmp_path / "results", built))
    assert "streak-2" in capsys.readouterr().out
    assert (built / "losses.csv").is_file()


def test_a_scene_may_be_called_by_a_number(tmp_path):
    scene = capture_in(tmp_path / "capture" / "0042")
    built = build(scene, tmp_path / "data", patterns=STREAKS)
    losses = record_losses(built, results_in(tmp_path / "results", built))
    assert list(losses.pattern) == ["streak-0", "streak-2"] * 2


def test_scenes_are_found_by_data_folder_and_by_their_own(built):
    assert built_scenes(built.parent) == [built]
    assert built_scenes(built) == [built]
    assert built_scenes(built.parent, "yard") == [built]
    for folder, scene in ((built.parent, "other"), (built.parents[1], ""), (built / "clean", "")):
        with pytest.raises(InputError, match="no finished scene"):
            built_scenes(folder, scene)
    assert set(read_manifest(built.parent)["scenes"]) == {"yard"}


def test_words_and_tables():
    assert describe_rain("raindrop", {"coverage": 0.12, "droplets": 300, "seed": 1}) == (
        "large drops over 12% of the picture, 300 droplets between them"
    )
    assert describe_rain("captured", {}) == "it rained when the photographs were taken"
    assert "pattern.json" in describe_rain("hail", {"stones": 3})
    table = markdown_table(("a", "empty", "b"), [(1, "", 2), (3, "", "")])
    assert table.splitlines() == ["| a | b |", "| --- | --- |", "| 1 | 2 |", "| 3 |  |"]
