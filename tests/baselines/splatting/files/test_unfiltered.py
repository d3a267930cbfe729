"""A model that was trained with the 2D filter looks the same in viewers, which have none."""

from dataclasses import replace

import numpy as np
import pytest
from splats import BACKGROUND, camera, cloud, photographed, with_values

from baselines.gaussian_splatting import GaussianSplattingClean
from baselines.splatting.files.ply import SPLATS, read_ply
from baselines.splatting.files.unfiltered import without_filter
from baselines.splatting.rasterizer import render
from baselines.splatting_profiles import PROFILES
from hydroviews.metrics import psnr

NEAR = 0.1


def shown(gaussians, seen_from, **options):
    return np.clip(render(gaussians, seen_from, BACKGROUND, near=NEAR, **options)[0], 0, 1)


@pytest.mark.parametrize("origin", [(0, 0, 0), (5e5, -3e4, 100)])
def test_seen_from_one_camera_it_is_the_same_picture(origin):
    small = replace(cloud(300, size=0.01), origin=np.array(origin, float))
    small = with_values(small, "opacity_logits", slice(0, 20), 60.0)
    one = camera(64, 48, origin=origin)
    expected = shown(small, one, antialiased=True)
    assert np.abs(shown(small, one) - expected).max() > 0.3
    found = without_filter(small, [one], NEAR)
    # A splat whose middle lies outside of the picture is as it was: it is left out of the comparison.
    pixels, _ = one.project(small.means + small.origin)
    inside = ((pixels >= 0) & (pixels <= (64, 48))).all(axis=1)
    np.testing.assert_allclose(
        shown(found.select(inside), one), shown(small.select(inside), one, antialiased=True), atol=2e-5
    )
    assert np.isfinite(found.opacity_logits).all()


def test_what_a_training_leaves_for_viewers_is_what_it_renders(tmp_path):
    scene = photographed(tmp_path, n_views=6)
    demo = PROFILES["demo"]
    config = replace(demo, iterations=60, antialiased=True, strategy=replace(demo.strategy, start=20, stop=50))
    method = GaussianSplattingClean(config, 0)
    method.fit(scene, tmp_path)
    method.save(tmp_path)
    for_viewers, exact = read_ply(tmp_path / SPLATS), method.export_gaussians()
    for view in scene.test_views:
        background = np.zeros(3, np.float32)
        rendered = method.render(view.camera)
        folded, bare = (np.clip(render(g, view.camera, background)[0], 0, 1) for g in (for_viewers, exact))
        assert psnr(folded, rendered) > psnr(bare, rendered) + 6
    again = GaussianSplattingClean.load(config, 0, tmp_path)
    (tmp_path / "again").mkdir()
    again.save(tmp_path / "again")
    assert (tmp_path / "again" / SPLATS).read_bytes() == (tmp_path / SPLATS).read_bytes()
