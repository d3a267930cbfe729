"""The example that draws a clip: streaks are new in every frame, drops stay, cameras lie on a smooth path."""

import numpy as np
import pytest
from synthetic import capture_in

from examples.rainy_clip import FRAMES, TARGET, camera, rainy_frames


def test_rain_of_several_effects_falls_on_every_frame_and_depends_on_the_seed(tmp_path):
    scene = capture_in(tmp_path / "yard")
    frames = list(rainy_frames(scene, ("streak-1", "raindrop-1"), 0, tmp_path / "work"))
    streaks = list(rainy_frames(scene, ("streak-1",), 0, tmp_path / "other"))
    assert len(frames) == len(scene.views)
    for view, both, falling in zip(scene.views, frames, streaks, strict=True):
        clean = view.image()
        assert both.shape == clean.shape
        assert 0 <= both.min() <= both.max() <= 1
        assert np.abs(both - falling).mean() > 0.5 / 255  # the lens adds to the streaks
        assert np.abs(falling - clean).mean() > 0.5 / 255
    for seed, same in ((0, True), (1, False)):
        first = next(rainy_frames(scene, ("streak-1", "raindrop-1"), seed, tmp_path / f"again-{seed}"))
        assert np.array_equal(first, frames[0]) == same


def test_cameras_look_at_the_target_from_neighbouring_places():
    cameras = [camera(0.1 * i) for i in range(FRAMES)]
    centres = np.array([-one.world_to_camera[:3, :3].T @ one.world_to_camera[:3, 3] for one in cameras])
    assert np.linalg.norm(np.diff(centres, axis=0), axis=1).max() < 1
    for one in cameras:
        pixels, depth = one.project(TARGET[None])
        assert depth[0] > 0
        assert pixels[0] == pytest.approx((one.width / 2, one.height / 2))
