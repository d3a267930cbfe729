import json

import cv2
import numpy as np
import pycolmap
import pytest
import torch
from distorted import LENS, colmap_capture
from refusals import assert_refused
from synthetic import capture_in, written_capture

from hydroviews import metrics
from hydroviews.captures.sfm import matching as features
from hydroviews.dataset.build import build
from hydroviews.dataset.variants import open_clean, open_variant
from hydroviews.errors import InputError
from hydroviews.formats.mask_files.hidden_share import scene_hidden_notes
from hydroviews.formats.read import read_scene
from hydroviews.formats.writers import write_nerfstudio
from hydroviews.rain.patterns import Pattern
from hydroviews.scene.images import write_png
from hydroviews.scene.masks import find_mask, fit_ignored, mask_name, read_ignored, write_ignored


def block(height, width, rows, columns):
    ignored = np.zeros((height, width), bool)
    ignored[rows, columns] = True
    return ignored


@pytest.fixture
def hidden():
    return block(36, 48, slice(6, 18), slice(20, 31))


@pytest.fixture
def capture(tmp_path, hidden):
    """A COLMAP capture of nine views, of which two have masks."""
    folder = written_capture(tmp_path / "yard")
    for name in ("view-00.png", "view-03.png"):
        write_ignored(folder / "masks" / mask_name(name), hidden)
    return folder


def test_on_disk_black_is_hidden_as_for_colmap(tmp_path, hidden):
    path = tmp_path / mask_name("a.jpg")
    assert path.name == "a.jpg.png"
    write_ignored(path, hidden)
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert np.array_equal(pixels, np.where(hidden, 0, 255))  # of one channel
    assert np.array_equal(read_ignored(path), hidden)


@pytest.mark.parametrize(("name", "message"), [("mask", "cannot be read as a mask"), ("none", "no such image")])
def test_a_broken_mask(tmp_path, name, message):
    (tmp_path / "mask.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=rf"{name}\.png: {message}"):
        read_ignored(tmp_path / f"{name}.png")


def test_a_pixel_that_a_hidden_one_touches_is_hidden(hidden):
    small = fit_ignored(hidden, 24, 18)
    assert np.array_equal(small, hidden.reshape(18, 2, 24, 2).any(axis=(1, 3)))
    odd = fit_ignored(hidden, 20, 15)
    rows, columns = np.nonzero(odd)
    assert (rows.min(), rows.max() + 1) == (6 * 15 // 36, -(-18 * 15 // 36))
    assert (columns.min(), columns.max() + 1) == (20 * 20 // 48, -(-31 * 20 // 48))
    large = fit_ignored(hidden, 96, 72)
    assert large[hidden.repeat(2, 0).repeat(2, 1)].all()
    assert large.mean() < 1.3 * hidden.mean()


def test_views_hide_what_their_mask_does_at_every_size(capture, hidden):
    scene = read_scene(capture)
    assert "2 of 9 views have a mask" in scene.notes
    by_name = {view.name: view for view in scene.views}
    assert np.array_equal(by_name["view-00"].ignored(), hidden)
    assert by_name["view-01"].ignored() is None
    small = {view.name: view for view in scene.resized(24).views}
    assert np.array_equal(small["view-03"].ignored(), fit_ignored(hidden, 24, 18))
    write_ignored(capture / "masks" / mask_name("view-00.png"), np.zeros((30, 48), bool))
    with pytest.raises(InputError, match=r"view-00\.png\.png: image and camera differ in size"):
        by_name["view-00"].ignored()


def test_masks_are_undistorted_like_their_pictures(tmp_path):
    folder = colmap_capture(tmp_path / "lens")
    hidden = block(LENS.height, LENS.width, slice(8, 20), slice(6, 25))
    write_ignored(folder / "masks" / mask_name("view00.png"), hidden)
    white = np.where(hidden[..., None], 0.0, 1.0).astype(np.float32).repeat(3, axis=2)
    write_png(folder / "images" / "view00.png", white)
    view = read_scene(folder).views[0]
    dark = view.image()[..., 0] < 1 - 1e-3  # hidden pixels, or mixed with one
    assert np.array_equal(view.ignored(), dark)
    assert not np.array_equal(dark, hidden[: dark.shape[0], : dark.shape[1]])


def test_nerfstudio_masks_by_path_and_beside(tmp_path, hidden):
    write_ignored(tmp_path / "masks" / mask_name("view-02.png"), hidden)
    write_ignored(tmp_path / "elsewhere.png", ~hidden)
    path = tmp_path / "transforms.json"
    write_nerfstudio(capture_in(tmp_path), path, "images")
    content = json.loads(path.read_text())
    content["frames"][5]["mask_path"] = "elsewhere.png"
    path.write_text(json.dumps(content))
    views = read_scene(tmp_path).views
    assert np.array_equal(views[2].ignored(), hidden)
    assert np.array_equal(views[5].ignored(), ~hidden)
    assert views[0].mask is None
    path.write_text(path.read_text().replace("elsewhere", "gone"))
    assert_refused(tmp_path, r"gone\.png: no such mask")


def test_a_built_scene_keeps_masks_where_other_software_finds_them(capture, tmp_path, hidden):
    folder = build(read_scene(capture), tmp_path / "data", patterns=[Pattern("streak", 0)], long_side=24)
    small = fit_ignored(hidden, 24, 18)
    for opened in (open_clean(folder), open_variant(folder, "streak-0")):
        views = {view.name: view for view in opened.views}
        assert np.array_equal(views["view-03"].ignored(), small)
        assert views["view-01"].ignored() is None
    frames = json.loads((folder / "streak-0" / "transforms.json").read_text())["frames"]
    named = [frame["mask_path"] for frame in frames]  # other software wants one for every frame, or none
    assert named == [f"masks/{view.name}.png.png" for view in opened.views]
    assert np.array_equal(read_ignored(folder / "streak-0" / named[3]), small)
    assert not read_ignored(folder / "streak-0" / named[1]).any()
    write_ignored(capture / "masks" / mask_name("view-03.png"), ~hidden)
    with pytest.raises(InputError, match="another request"):
        build(read_scene(capture), tmp_path / "data", patterns=[], long_side=24)


def test_masks_of_a_capture_the_other_way_round_are_told(capture, tmp_path, hidden):
    def read_with(ignored):
        for path in list((capture / "images").glob("view-*.png")):
            write_ignored(capture / "masks" / mask_name(path.name), ignored)
        return read_scene(capture)

    assert "black is hidden: are they the other way round?" in scene_hidden_notes(read_with(~hidden))[0]
    with pytest.raises(InputError, match=r"yard: masks: every pixel is hidden\n.*black where"):
        build(read_with(hidden | True), tmp_path / "data", patterns=[], long_side=24)


def test_no_features_where_hidden(tmp_path):
    names, noise = ["a.png", "b.png"], np.random.default_rng(0).random((60, 80, 3)).astype(np.float32)
    texture = cv2.resize(noise, (320, 240), interpolation=cv2.INTER_CUBIC)
    for name in names:
        write_png(tmp_path / "images" / name, np.clip(texture, 0, 1))
    hidden = block(240, 320, slice(50, 200), slice(0, 160))
    write_ignored(tmp_path / "masks" / mask_name("a.png"), hidden)
    given = tmp_path / "d.db", tmp_path / "images", names, "SIMPLE_RADIAL"
    with pytest.raises(InputError, match=r"1 of 2 images have no mask\n.*no b\.png\.png"):
        features.register(*given, shared=True, masks=tmp_path / "masks")
    write_ignored(tmp_path / "masks" / "b.png", np.zeros_like(hidden))  # COLMAP takes this name as well
    features.register(*given, shared=True, masks=tmp_path / "masks")
    features.extract(*given, tmp_path / "masks")
    with pycolmap.Database.open(tmp_path / "d.db") as database:
        found = {n: database.read_keypoints(database.read_image_with_name(n).image_id)[:, :2] for n in names}
    inside = {n: hidden[tuple((f - 0.5).round().astype(int).clip(0, (319, 239)).T[::-1])] for n, f in found.items()}
    assert inside["b.png"].sum() > 50
    assert inside["a.png"].sum() == 0
    assert len(found["a.png"]) > 50


@pytest.mark.parametrize("metric", [metrics.psnr, metrics.ssim, metrics.lpips])
def test_hidden_pixels_do_not_change_a_score(metric, hidden):
    rng = np.random.default_rng(0)
    image, target, noise = rng.random((3, 36, 48, 3)).astype(np.float32)
    score = metric(image, target, ignored=hidden)
    other = np.where(hidden[..., None], noise, image)
    assert metric(other, np.where(hidden[..., None], noise[::-1], target), ignored=hidden) == score
    assert metric(np.where(hidden[..., None], image, noise), target, ignored=hidden) != score
    assert metric(image, target, ignored=np.zeros_like(hidden)) == pytest.approx(metric(image, target), rel=1e-6)
    with pytest.raises(ValueError, match="every pixel is hidden"):
        metric(image, target, ignored=np.ones_like(hidden))
    for wrong in (hidden[1:], hidden.astype(np.uint8)):
        with pytest.raises(ValueError, match="mask of"):
            metric(image, target, ignored=wrong)


def test_scores_of_what_is_left_known_answers():
    ignored = block(30, 40, slice(0, 30), slice(0, 20))  # the left half
    target = np.full((30, 40, 3), 0.5, np.float32)
    image = target.copy()
    image[:, 20:] += 0.1
    image[:, :20] = 1
    assert metrics.psnr(image, target, ignored=ignored) == pytest.approx(20, abs=1e-4)
    right = metrics.ssim(image[:, 20:], target[:, 20:])
    assert metrics.ssim(image, target, ignored=ignored) == pytest.approx(right, abs=1e-12)
    with pytest.raises(ValueError, match="every window"):
        metrics.ssim(image, target, ignored=block(30, 40, slice(0, 30), slice(5, 40, 9)))


def test_a_batch_has_a_mask_each():
    rng = np.random.default_rng(1)
    images, targets = (torch.from_numpy(rng.random((2, 3, 20, 30))) for _ in range(2))
    ignored = torch.from_numpy(np.stack([block(20, 30, slice(0, 5), slice(i, 9)) for i in range(2)]))
    for metric in (metrics.psnr, metrics.ssim):
        together = metric(images, targets, ignored=ignored)
        pairs = zip(images.permute(0, 2, 3, 1), targets.permute(0, 2, 3, 1), ignored, strict=True)
        alone = [metric(image, target, ignored=mask) for image, target, mask in pairs]
        assert together.tolist() == pytest.approx(alone, rel=1e-9)


@pytest.mark.parametrize("stored", ["B\u00e4ume.jpg", "Ba\u0308ume.jpg"], ids=["composed", "decomposed"])
def test_umlauts_of_a_mask_may_be_stored_in_either_way(tmp_path, stored):
    assert find_mask(tmp_path, "B\u00e4ume.jpg") is None
    write_ignored(tmp_path / mask_name(stored), np.ones((2, 2), bool))
    for named in ("B\u00e4ume.jpg", "Ba\u0308ume.jpg"):
        assert find_mask(tmp_path, named) == tmp_path / mask_name(stored)
