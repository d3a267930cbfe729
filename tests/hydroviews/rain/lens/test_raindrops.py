import json
from dataclasses import replace

import numpy as np
import pytest
from kept_blender import bakes, needs_blender
from wet_lens import DRY, PATTERN, camera, one_drop, prepared_lens, raindrops

from hydroviews.rain.lens.optics import bake as lens_bake
from hydroviews.rain.lens.optics.bake import aperture_radius, bake, bake_matte, focus_disk, lens_water, trace
from hydroviews.rain.lens.optics.mesh import water_mesh
from hydroviews.rain.lens.optics.path_matte import defocus
from hydroviews.rain.lens.patterns.mist import mist_veil
from hydroviews.rain.lens.patterns.pattern import draw_pattern
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import to_linear, to_srgb


def composite(clean, layers):
    passing = ((1 - layers["M"]) * (1 - layers["V"]))[..., None]
    return to_srgb(to_linear(clean) * passing + np.stack([layers[c] for c in "RGB"], axis=-1))


def test_mist_alone_mixes_in_the_air_of_the_scene(tmp_path, waves):
    lens, pattern = camera(80, 60), replace(DRY, mist=0.5, air=(1.0, 0.9, 0.8))
    rain, views = raindrops(pattern, lens)
    layers = rain.prepare(lens, tmp_path).layers(waves, views[0])
    veil = mist_veil(pattern, 80, 60, 0.0)
    assert np.array_equal(layers["V"], veil)
    for channel, light in zip("RGB", (0.6, 0.63, 0.64), strict=True):
        np.testing.assert_allclose(layers[channel], veil * light, rtol=1e-5)
    assert json.loads(json.dumps(rain.parameters))["air_light"] == pytest.approx([0.6, 0.63, 0.64])


@pytest.mark.parametrize(("views", "frames"), [(7, [0, 0, 0, 1, 1, 2, 2]), (2, [0, 1])])
def test_views_share_out_the_key_frames_in_order(tmp_path, waves, views, frames):
    rain, views = prepared_lens(replace(DRY, mist=0.5), camera(80, 60), tmp_path, count=views)
    veils = [rain.layers(waves, view)["V"] for view in views]
    for i in range(len(frames) - 1):
        assert np.array_equal(veils[i], veils[i + 1]) == (frames[i] == frames[i + 1])
    assert sorted(p.name for p in tmp_path.glob("*.npz")) == [f"matte-{i}.npz" for i in sorted(set(frames))]


def test_meshes_are_closed_small_and_outside_the_lens():
    mesh = lens_water(replace(draw_pattern(np.random.default_rng(0), 2), coverage=0.25), camera(400, 300), 2)
    assert 20_000 < len(mesh.vertices) < 400_000
    assert np.all(np.isfinite(mesh.vertices))
    assert np.all(mesh.vertices[mesh.bases.ravel(), 2] == 1)
    assert mesh.vertices[:, 2].min() == 1
    for faces, side in ((mesh.caps, 1), (mesh.bases, -1)):
        a, b, c = (mesh.vertices[faces[:, i], :2].astype(float) for i in range(3))
        up = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        assert np.mean(up * side > 0) > 0.999


@bakes
@pytest.mark.parametrize(
    ("lens_renderer", "focus", "least"),
    [("disk", "scene", 30), ("aperture", "scene", 34), ("disk", "drops", 30), ("aperture", "drops", 33)],
)
def test_mattes_agree_with_full_path_tracing(tmp_path, waves, lens_renderer, focus, least):
    """Decibels between what drops show as they are baked and as every ray is followed."""
    lens, light = camera(80, 60), to_linear(waves)
    pattern = replace(PATTERN, lens_renderer=lens_renderer, focus_blur=0.03 if focus == "scene" else 0.04, focus=focus)
    disk = focus_disk(pattern, lens)
    water, aperture = lens_water(pattern, lens, 0), aperture_radius(disk, lens)
    traced, _ = trace(water, lens, light, 128, tmp_path, aperture, focus=focus)
    matte = bake_matte(pattern, lens, tmp_path)
    seen = defocus(light, disk) if (lens_renderer, focus) == ("disk", "drops") else light
    inside = traced[..., 3] > 0.5
    assert 0.1 < inside.mean() < 0.4
    assert np.abs(matte.mask - traced[..., 3]).mean() < 0.01
    error = to_srgb(matte.apply(seen))[inside] - to_srgb(traced[..., :3])[inside]
    psnr = -10 * np.log10((error**2).mean())
    assert psnr > least, psnr


@bakes
def test_the_traced_technique_goes_through_the_same_layers(tmp_path, monkeypatch, waves):
    monkeypatch.setattr("hydroviews.rain.lens.raindrops.TRACED_SAMPLES", 64)
    seen = {}
    for lens_renderer in ("disk", "traced"):
        pattern = replace(PATTERN, lens_renderer=lens_renderer, mist=0.3)
        rain, views = prepared_lens(pattern, camera(80, 60), tmp_path / lens_renderer)
        seen[lens_renderer] = composite(waves, rain.layers(waves, views[0]))
    assert np.abs(seen["disk"] - seen["traced"]).mean() < 0.01


@needs_blender
def test_a_bake_is_the_same_in_two_processes_and_kept(tmp_path, monkeypatch, kept_blender):
    lens = camera(33, 24)
    pattern = replace(PATTERN, focus_blur=0.05)
    first = bake_matte(pattern, lens, tmp_path / "a")
    monkeypatch.setattr(lens_bake, "run_blender", kept_blender)  # the second has made another one before
    for name, size in (("b", (24, 33)), ("c", (33, 24))):
        bake_matte(pattern, camera(*size), tmp_path / name)
    a, c = ((tmp_path / name / "matte-0.npz").read_bytes() for name in "ac")
    assert a == c
    monkeypatch.setattr(lens_bake, "run_blender", pytest.fail)
    kept = bake_matte(replace(pattern, mist=0.9, air=(1.0, 1.0, 1.0)), lens, tmp_path / "a")
    assert np.array_equal(kept.mask, first.mask)
    assert (kept.paths != first.paths).nnz == 0


@bakes
@pytest.mark.parametrize("size", [(1, 1), (17, 15), (200, 20)])
def test_any_size_of_picture(tmp_path, size):
    rain, views = prepared_lens(PATTERN, camera(*size), tmp_path)
    layers = rain.layers(np.full((*size[::-1], 3), 0.5, np.float32), views[3])
    assert all(plane.shape == size[::-1] and np.isfinite(plane).all() for plane in layers.values())
    assert 0 <= layers["M"].min() <= layers["M"].max() <= 1


@bakes
@pytest.mark.parametrize("degrees", [50, 90])
def test_total_reflection_loses_no_sense_and_gains_no_light(tmp_path, degrees):
    lens = camera(60, 40)
    matte = bake(water_mesh(one_drop(0.6, 0.4, 0.25, degrees=degrees), np.inf, lens), lens, tmp_path, paths=4)
    rows = np.asarray(matte.paths.sum(axis=1)).ravel()
    assert 0 < rows.max() <= 1 + 1e-5
    grey = np.full((40, 60, 3), 0.4, np.float32)
    drops = matte.apply(grey)
    assert np.all(np.isfinite(drops))
    # In an evenly lit world water is invisible: what paths lose, the ambient light gives back.
    np.testing.assert_allclose(drops, matte.mask[..., None] * grey, atol=1e-4)


@bakes
def test_drops_over_the_border_and_over_the_whole_lens(tmp_path):
    lens = camera(48, 32)
    waters = one_drop(0.0, 0.4, 0.2), one_drop(0.6, 0.4, 3.0, degrees=30)
    border, flood = (bake(water_mesh(water, np.inf, lens), lens, tmp_path, paths=3) for water in waters)
    assert border.mask[16, 0] == 1
    assert border.mask[:, 12:].max() == 0
    assert flood.mask.min() == 1
    assert np.all(np.isfinite(flood.apply(np.ones((32, 48, 3), np.float32))))


@bakes
def test_saturated_lamps_sparkle_in_drops(tmp_path, monkeypatch):
    lens = camera(60, 40)
    matte = bake(water_mesh(one_drop(0.6, 0.4, 0.25), np.inf, lens), lens, tmp_path, paths=4)
    monkeypatch.setattr("hydroviews.rain.lens.raindrops.bake_matte", lambda *_: matte)
    night = np.full((40, 60, 3), 0.1, np.float32)
    night[18:20, 30:32] = 1.0
    rain, views = prepared_lens(replace(PATTERN, mist=0.0), lens, tmp_path)
    layers = rain.layers(night, views[0])
    assert matte.apply(to_linear(night)).max() < max(layers[c].max() for c in "RGB") < np.inf
    assert composite(night, layers).max() <= 1


@bakes
def test_one_drop_sits_where_it_should_and_turns_the_world_upside_down(tmp_path):
    # Pixels that are not square and a principal point off the middle; a round drop on the picture.
    lens = Camera(60, 40, 40.0, 50.0, 20.0, 25.0, np.eye(4))
    side = np.sqrt(60 * 40)
    drop = (30 / side, 20 / side, 9 / side)
    matte = bake(water_mesh(one_drop(*drop, degrees=45), np.inf, lens), lens, tmp_path, paths=4)
    y, x = np.mgrid[0:40, 0:60] + 0.5
    centre = [(matte.mask * axis).sum() / matte.mask.sum() for axis in (x, y)]
    np.testing.assert_allclose(centre, [30, 20], atol=0.1)
    assert matte.mask.sum() == pytest.approx(np.pi * 9**2, rel=0.03)
    bright_above = np.repeat((y < 20).astype(np.float32)[..., None], 3, axis=2)
    seen = matte.apply(bright_above)[..., 0]
    assert seen[14:16, 30].mean() < 0.2  # the upper part of the drop shows what is below
    assert seen[24:26, 30].mean() > 0.8
