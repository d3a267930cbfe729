import pandas as pd
import pytest

from leaderboard.records import columns
from leaderboard.tables import scene_keys, scene_table, to_markdown


def rows(*values: tuple) -> pd.DataFrame:
    records = [
        dict.fromkeys(columns())
        | {
            "pattern": f"{effect}-0",
            "seed": 0,
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
        for method, effect, status, psnr in values
    ]
    return pd.DataFrame(records)


def test_means_share_of_gap_and_order():
    table = rows(
        ("ours", "streak", "done", 24.0),
        ("ours", "streak", "done", 26.0),
        ("3dgs", "streak", "done", 20.0),
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
    table.loc[3, "data_sha256"] = "an older build of the scene"
    summary = scene_table(table, "yard", "demo", "given-poses")["streak"]
    assert summary.loc["ours", "gap"] == pytest.approx(-0.25)
    assert pd.isna(summary.loc["theirs", "gap"])
    assert summary.loc["3dgs-clean", "gap"] == 1


def test_failed_runs_are_counted_and_left_out_of_the_mean():
    table = rows(
        ("ours", "streak", "done", 24.0),
        ("ours", "streak", "failed", None),
        ("theirs", "streak", "failed", None),
        ("3dgs-clean", "clean", "done", 30.0),
    )
    summary = scene_table(table, "yard", "demo", "given-poses")["streak"]
    assert summary.loc["ours", "psnr"] == 24
    assert summary.loc["ours", "runs"] == "1/2"
    assert pd.isna(summary.loc["theirs", "psnr"])
    text = to_markdown(scene_table(table, "yard", "demo", "given-poses"))
    assert "| ours | 24.00 | 0.5000 |  |  |  |  | 1/2 |" in text
    assert "| theirs |  |" in text


def test_the_ceiling_stands_under_every_effect():
    table = rows(
        ("3dgs", "streak", "done", 20.0), ("3dgs", "raindrop", "done", 22.0), ("3dgs-clean", "clean", "done", 30.0)
    )
    summary = scene_table(table, "yard", "demo", "given-poses")
    assert summary.loc["3dgs-clean", ("streak", "psnr")] == 30
    assert summary.loc["3dgs-clean", ("raindrop", "psnr")] == 30


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
        assert list(summary.runs) == ["1/1"] * 3
