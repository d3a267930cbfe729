"""Scenes that were taken in rain: trained and pictured, not scored; and hidden pixels in the scores of others."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from synthetic import written_capture

from hydroviews import metrics
from hydroviews.dataset.manifest import data_hash
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_json
from hydroviews.formats.read import read_scene
from hydroviews.scene.images import read_image
from hydroviews.scene.masks import mask_name, write_ignored
from leaderboard.evaluate import evaluate, outcome

pytestmark = pytest.mark.usefixtures("toys", "trained_here")


@pytest.fixture
def walk(tmp_path) -> Path:
    """A capture."""
    return written_capture(tmp_path / "walk")


def say(capture: Path, rain: str) -> None:
    write_json(capture / "capture.json", {"rain": rain})


def test_a_scene_taken_in_rain_is_trained_and_pictured_but_not_scored(walk, request_of, tmp_path, caplog):
    say(walk, "captured")
    request = request_of(scene=str(walk), patterns=())
    (record,) = evaluate(request)  # the floor itself; there is no ceiling
    assert (record.status, record.effect, record.pattern) == ("done", "captured", "captured-0")
    assert record.reason == "captured in rain: no clean ground truth"
    assert not record.scores
    assert record.train_s == 0.5
    results = tmp_path / "results/demo/toy_methods.MeanColour/walk/captured-0/seed-0"
    assert len(list((results / "renders").iterdir())) == record.n_test
    assert read_image(results / "preview.png").shape[1] == 2 * 48  # the rainy view and the render
    row = pd.read_csv(tmp_path / "results/leaderboard.csv").iloc[0]
    assert row[["psnr", "ssim", "lpips_vgg"]].isna().all()
    assert "not scored, captured in rain" in caplog.text
    assert "| toy_methods:MeanColour |  |" in outcome(record, tmp_path / "results")
    assert evaluate(request) == [record]
    assert not (tmp_path / "data/demo/walk/clean").exists()
    assert read_scene(tmp_path / "data/demo/walk/captured-0").captured_rainy


def test_what_needs_clean_views_is_refused(walk, request_of):
    say(walk, "captured")
    with pytest.raises(InputError, match="learns from clean views, and walk was taken in rain"):
        evaluate(request_of("MeanColourClean", scene=str(walk), patterns=()))
    with pytest.raises(InputError, match="taken in rain, and streak-0 is not added to that"):
        evaluate(request_of(scene=str(walk)))
    say(walk, "some")
    with pytest.raises(InputError, match=r"capture\.json: unknown rain"):
        evaluate(request_of(scene=str(walk), patterns=()))


def test_hidden_pixels_are_not_scored(walk, request_of, tmp_path):
    hidden = np.zeros((36, 48), bool)
    hidden[10:20, 5:15] = True
    write_ignored(walk / "masks" / mask_name("view-00.png"), hidden)
    evaluate(request_of(scene=str(walk)))
    results = tmp_path / "results/demo/toy_methods.MeanColour/walk/streak-0/seed-0"
    views = pd.read_csv(results / "per_view.csv").set_index("view")
    for name in ("view-00", "view-08"):
        pair = read_image(results / f"renders/{name}.png"), read_image(tmp_path / f"data/demo/walk/clean/{name}.png")
        ignored = hidden if name == "view-00" else None
        assert views.psnr[name] == pytest.approx(metrics.psnr(*pair, ignored=ignored), abs=1e-6)
        assert views.ssim[name] == pytest.approx(metrics.ssim(*pair, ignored=ignored), abs=1e-6)
    whole = read_image(results / "renders/view-00.png"), read_image(tmp_path / "data/demo/walk/clean/view-00.png")
    assert abs(views.psnr["view-00"] - metrics.psnr(*whole)) > 1e-3
    manifest = tmp_path / "data/demo/manifest.json"
    content = json.loads(manifest.read_text())
    content["scenes"]["walk"]["files"]["masks/view-00.png.png"] = "another"
    manifest.write_text(json.dumps(content))
    record = json.loads((results / "record.json").read_text())
    assert data_hash(tmp_path / "data/demo", "walk", "streak-0") != record["data_sha256"]
    with pytest.raises(InputError, match=r"masks/view-00\.png\.png: changed"):
        evaluate(request_of(scene=str(walk)))
