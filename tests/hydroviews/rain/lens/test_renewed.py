from dataclasses import replace

import numpy as np
import pytest
from kept_blender import bakes
from wet_lens import DRY, PATTERN, camera, one_drop, prepared_lens

from hydroviews.errors import InputError
from hydroviews.rain.effect import fall
from hydroviews.rain.lens.effect import RaindropEffect, SharpRaindropEffect
from hydroviews.rain.lens.optics import bake as lens_bake
from hydroviews.rain.lens.optics.bake import bake, bake_matte, bake_paths
from hydroviews.rain.lens.optics.drop_bank import DropPainter, cut
from hydroviews.rain.lens.optics.mesh import water_mesh
from hydroviews.rain.lens.optics.path_matte import defocus
from hydroviews.rain.light import expand_highlights
from hydroviews.scene.images import to_linear, to_srgb

SMALL = replace(PATTERN, renewed=0.5, droplets=10, seed=2, key_frames=1, air=(1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        *(({"renewed": share}, r"renewed drops[\s\S]*from 0 to 1") for share in (-0.1, 1.5, float("nan"))),
        ({"focus": "nothing"}, "focus of the lens"),
        ({"renewed": 0.5, "lens_renderer": "traced"}, r"traced[\s\S]*disk or aperture"),
    ],
    ids=str,
)
def test_lenses_that_cannot_be_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        replace(PATTERN, **changes)


@pytest.mark.parametrize("changes", [{}, {"renewed": 0.5}, {"renewed": 1.0}, {"focus": "drops"}], ids=str)
def test_a_dry_lens_needs_no_blender(tmp_path, monkeypatch, waves, changes):
    monkeypatch.setattr(lens_bake, "run_blender", pytest.fail)
    rain, views = prepared_lens(replace(DRY, **changes), camera(80, 60), tmp_path)
    assert not any(plane.any() for view in views for plane in rain.layers(waves, view).values())


@bakes
def test_nothing_renewed_is_the_fixed_window(tmp_path, waves):
    lens, light = camera(80, 60), expand_highlights(to_linear(waves))
    rain, views = prepared_lens(replace(PATTERN, mist=0.0), lens, tmp_path / "a")
    layers = rain.layers(waves, views[0])
    matte = bake_matte(replace(PATTERN, renewed=1.0), lens, tmp_path / "b")  # a matte that knows of no renewal
    assert np.array_equal(layers["M"], matte.mask)
    assert np.array_equal(np.stack([layers[c] for c in "RGB"], -1), matte.apply(light))
    assert not list(tmp_path.rglob("drops-*"))


@bakes
def test_views_are_the_same_in_any_order_and_after_an_interruption(tmp_path, monkeypatch, waves):
    monkeypatch.setattr("hydroviews.rain.lens.renewed.LENSES", 2)
    rain, views = prepared_lens(SMALL, camera(40, 30), tmp_path / "a", count=6)
    clean = waves[::2, ::2]
    in_order = [fall(rain, clean, view) for view in views]
    again, _ = prepared_lens(SMALL, camera(40, 30), tmp_path / "a", count=6)
    monkeypatch.setattr(lens_bake, "run_blender", pytest.fail)  # all that is needed was kept
    for view, expected in reversed(list(zip(views, in_order, strict=True))):
        found = fall(again, clean, view)
        assert all(np.array_equal(found[name], expected[name]) for name in expected)
    masks = [layers["M"] for layers in in_order]
    assert all(np.abs(now - before).max() > 0.1 for now, before in zip(masks[1:], masks, strict=False))
    damaged = next((tmp_path / "a").glob("drops-*.npz"))
    damaged.write_bytes(damaged.read_bytes()[:1000])
    broken, _ = prepared_lens(SMALL, camera(40, 30), tmp_path / "a", count=6)
    with pytest.raises(InputError, match=f"{damaged.name}: cannot be read"):
        for view in views:
            broken.layers(clean, view)


@bakes
def test_one_view_and_two_sizes_of_picture(tmp_path, monkeypatch):
    monkeypatch.setattr("hydroviews.rain.lens.renewed.LENSES", 1)
    grey = np.full((120, 160, 3), 0.5, np.float32)
    masks = []
    for k in (2, 4):
        rain, views = prepared_lens(SMALL, camera(40 * k, 30 * k), tmp_path / str(k), count=1)
        layers = rain.layers(grey[: 30 * k, : 40 * k], views[0])
        mask, veil = layers["M"], layers["V"]
        masks.append(mask)
        np.testing.assert_allclose(layers["R"] - 0.6 * (1 - mask) * veil, 0.2140411 * mask, atol=1e-3)
    small = masks[1].reshape(60, 2, 80, 2).mean(axis=(1, 3))
    assert np.corrcoef(small.ravel(), masks[0].ravel())[0, 1] > 0.9  # drops sit on whole pixels
    assert masks[0].mean() > 0.05


@bakes
def test_a_moved_drop_is_nearly_one_baked_at_its_place(tmp_path, waves):
    lens, light, step = camera(80, 60), to_linear(waves), 8
    drops = [one_drop(x / np.sqrt(4800), 0.45, 0.12) for x in (36, 36 + step)]
    here, there = (bake(water_mesh(water, np.inf, lens), lens, tmp_path, paths=6) for water in drops)
    assert np.abs(np.roll(here.mask, step, axis=1) - there.mask).max() < 0.35
    inside = there.mask > 0.9
    traced = bake_paths(water_mesh(drops[0], np.inf, lens), lens, tmp_path, paths=6)
    bank = cut(traced, (0, 0), 1, lambda at: np.zeros(len(at), np.int64))
    painter = DropPainter(light)
    painter.paint(bank, np.array([0]), (step, 0))
    seen = to_srgb(there.apply(light))
    moved, unmoved = (((to_srgb(one) - seen)[inside] ** 2).mean() for one in (painter.radiance, here.apply(light)))
    assert np.sqrt(moved) < 0.06
    assert moved < 0.1 * unmoved


@bakes
def test_a_drop_over_the_whole_lens_in_focus_hides_the_scene(tmp_path, waves):
    lens = camera(80, 60)
    flood = bake(water_mesh(one_drop(0.6, 0.4, 3.0, degrees=30), np.inf, lens), lens, tmp_path, paths=2, focus="drops")
    assert flood.mask.min() == 1
    drops = flood.apply(defocus(to_linear(waves), 4.0))
    layers = {"M": flood.mask, "V": 0 * flood.mask, **{c: drops[..., i] for i, c in enumerate("RGB")}}
    told = {"focus": "drops", "focus_blur": 0.05}
    seen, in_the_dark = (SharpRaindropEffect().composite(told, scene, layers) for scene in (waves, 0 * waves))
    np.testing.assert_allclose(seen, to_srgb(drops), atol=1e-6)
    np.testing.assert_array_equal(seen, in_the_dark)


def test_behind_drops_in_focus_every_point_is_a_disk_of_linear_light():
    clean, disk = np.zeros((31, 31, 3), np.float32), 7.0
    clean[15, 15] = 1
    nothing = {name: np.zeros((31, 31), np.float32) for name in "MVRGB"}
    told = {"focus": "drops", "focus_blur": disk / 31}
    spread = to_linear(SharpRaindropEffect().composite(told, clean, nothing)).astype(np.float64)[..., 0]
    assert spread.sum() == pytest.approx(1, abs=1e-3)
    y, x = np.mgrid[0:31, 0:31] - 15
    assert spread[np.hypot(x, y) > disk / 2 + 0.8].max() == 0
    np.testing.assert_allclose(spread[np.hypot(x, y) < disk / 2 - 0.8], 4 / (np.pi * disk**2), rtol=0.01)
    plain = {"focus": "scene", "focus_blur": disk / 31}
    np.testing.assert_allclose(RaindropEffect().composite(plain, clean, nothing), clean, atol=1e-6)
