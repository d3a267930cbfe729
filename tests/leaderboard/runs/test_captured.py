"""Scenes that were taken in rain, alone or with clean photographs; and hidden pixels in scores."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from paired import NAMES, name_cameras, paired_capture
from synthetic import written_capture

from hydroviews import metrics
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.manifest import data_hash
from hydroviews.dataset.sources import build_source
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.formats.capture_json import CAPTURED
from hydroviews.formats.read import read_scene
from hydroviews.profiles import find_profile
from hydroviews.scene.images import read_image, write_png
from hydroviews.scene.masks import mask_name, write_ignored
from leaderboard.evaluate import evaluate, outcome
from leaderboard.runs.run import Run
from leaderboard.tables import rain_losses as severity

pytestmark = pytest.mark.usefixtures("toys", "trained_here")
PARTS = [0, 1, 2, 3, 4, 5], [6, 7, 8]  # clutter and extra


def built(tmp_path: Path, capture: Path) -> Path:
    return build_source(str(capture), tmp_path / "data" / "demo", find_profile("demo"))


def test_of_both_photographs_ceiling_and_floor_are_scored(tmp_path, request_of, monkeypatch):
    capture = paired_capture(tmp_path / "walk")
    (capture / "LICENSE").write_text("CC0")
    request = request_of(scene=str(capture), patterns=())
    ceiling, floor = evaluate(request)
    assert (floor.status, floor.effect, floor.pattern, floor.reason) == ("done", "captured", CAPTURED, "")
    assert (ceiling.pattern, ceiling.status) == ("clean", "done")
    folder = tmp_path / "results/demo/toy_methods.MeanColour/walk/captured-0/seed-0"
    scores = [
        metrics.psnr(read_image(folder / f"renders/{name}.png"), read_image(capture / f"clean/{name}.png"))
        for name in (NAMES[0], NAMES[8])
    ]
    assert floor.scores["psnr"] == pytest.approx(np.mean(scores), abs=1e-4)
    assert read_image(folder / "preview.png").shape[1] == 4 * 48  # rainy view, render, clean view, error
    assert "| 100 % |" in outcome(floor, tmp_path / "results")  # of the gap, in the ceiling's row
    scene = tmp_path / "data/demo/walk"
    assert verify(scene.parent) == []
    assert (scene / "licence" / "LICENSE").is_file()
    monkeypatch.setattr(severity, "CEILING", "toy_methods:MeanColourClean")
    monkeypatch.setattr(severity, "FLOOR", "toy_methods:MeanColour")
    losses = severity.record_losses(scene, tmp_path / "results")
    assert losses.pattern.tolist() == [CAPTURED]
    assert losses.loss[0] == pytest.approx(ceiling.scores["psnr"] - floor.scores["psnr"], abs=2e-3)
    assert f"{losses.loss[0]:.2f} dB" in (scene / "README.md").read_text()
    assert verify(scene.parent) == []
    assert evaluate(request) == [ceiling, floor]


def test_of_other_views_there_is_no_ceiling(tmp_path, request_of, caplog):
    capture = paired_capture(tmp_path / "walk", NAMES[:6], NAMES[6:])
    (floor,) = evaluate(request_of(scene=str(capture), patterns=()))
    assert (floor.status, floor.n_train, floor.n_test) == ("done", 6, 3)
    assert pd.read_csv(tmp_path / "results/leaderboard.csv").psnr[0] == floor.scores["psnr"] > 0
    assert "walk: its training views have no clean photographs: no row of toy_methods:MeanColourClean" in caplog.text
    with pytest.raises(InputError, match="learns from clean views, and walk was taken in rain, without them"):
        evaluate(request_of("MeanColourClean", scene=str(capture), patterns=()))
    preview = "results/demo/toy_methods.MeanColour/walk/captured-0/seed-0/preview.png"
    assert read_image(tmp_path / preview).shape[1] == 3 * 48  # there is no rainy view


@pytest.mark.parametrize(
    ("published", "prefixes"), [("robustnerf/statue", ("2clutter", "2extra")), ("onthego/corner", ("IMG_", "IMG_"))]
)
def test_published_captures_are_read_by_name(tmp_path, published, prefixes):
    """Their reduced photographs alone are there; cameras name those of full size, On-the-go's split has numbers."""
    name = published.replace("/", "_")
    folder = paired_capture(tmp_path / "root" / name, NAMES[:6], NAMES[6:])
    clutter, extra = ([prefix + str(i) for i in part] for prefix, part in zip(prefixes, PARTS, strict=True))
    for view, new in zip(NAMES, (*clutter, *extra), strict=True):
        (picture,) = folder.glob(f"*/{view}.png")
        (folder / "images_8").mkdir(exist_ok=True)
        picture.rename(folder / "images_8" / f"{new}.png")
    shutil.rmtree(folder / "rainy")
    shutil.rmtree(folder / "clean")
    name_cameras(folder, {view: [f"images/{new}.JPG"] for view, new in zip(NAMES, (*clutter, *extra), strict=True)})
    if published.startswith("onthego"):
        write_json(folder / "split.json", dict(zip(("clutter", "extra"), PARTS, strict=True)))
    scene = build_source(published, tmp_path / "data", find_profile("demo"), captures=tmp_path / "root")
    assert scene.name == name
    assert [view.name for view in open_variant(scene, CAPTURED).train_views] == clutter
    assert [view.name for view in open_clean(scene).test_views] == extra
    assert verify(scene.parent) == []


def test_another_clean_photograph_is_another_capture(tmp_path):
    capture = paired_capture(tmp_path / "walk")
    built(tmp_path, capture)
    write_png(capture / "clean" / "view-00.png", np.zeros((36, 48, 3), np.uint8))
    with pytest.raises(InputError, match="built from another request"):
        built(tmp_path, capture)


@pytest.mark.parametrize("clean", [NAMES, NAMES[6:]])
def test_a_method_gets_no_clean_photograph(tmp_path, clean):
    rainy = NAMES if clean == NAMES else NAMES[:6]
    folder = built(tmp_path, paired_capture(tmp_path / "walk", rainy, clean))
    one = Run("3dgs", "demo", 0, folder.parent, "walk", CAPTURED, tmp_path / "results")
    one.folder.mkdir(parents=True)
    with one.lent() as (lent, _):
        pictures = {path.relative_to(lent.data).as_posix() for path in lent.data.rglob("*.png")}
        assert pictures == {f"walk/{CAPTURED}/images/{name}.png" for name in open_clean(folder).split.train}
        assert [view.name for view in lent.training_scene().views] == NAMES  # of the others there are cameras


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
    assert (record.scores, record.train_s) == ({}, 0.5)
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
    content = read_json(manifest)
    content["scenes"]["walk"]["files"]["masks/view-00.png.png"] = "another"
    write_json(manifest, content)
    found = data_hash(tmp_path / "data/demo", "walk", "streak-0")
    assert found != read_json(results / "record.json")["data_sha256"]
    with pytest.raises(InputError, match=r"masks/view-00\.png\.png: changed"):
        evaluate(request_of(scene=str(walk)))
