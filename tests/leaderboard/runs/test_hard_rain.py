"""Photographs of hard cases against closed forms, and one row."""

import numpy as np
import pytest
from balls import photographed

from benchmarks.rain.hard_rain import AIR, foggy, painted, row
from hydroviews.scene.depth import depth_path, write_depth
from hydroviews.scene.images import to_linear, to_srgb


@pytest.fixture
def scene(tmp_path):
    return photographed(tmp_path / "images")


def test_fog_takes_half_of_the_light_at_the_middle_depth_and_all_of_the_sky(scene):
    view = scene.views[0]
    depth = np.full((view.camera.height, view.camera.width), 4.0, np.float32)
    depth[:3], depth[3:6] = np.inf, 8.0
    for one in scene.views:
        write_depth(depth_path(one), depth)
    clear, air = to_linear(view.image()), to_linear(np.full(3, AIR, np.float32))
    picture = foggy(scene)(view)
    assert np.allclose(picture[:3], AIR, atol=1e-5)
    assert np.allclose(picture[3:6], to_srgb(0.25 * clear + 0.75 * air)[3:6], atol=1e-5)
    assert np.allclose(picture[6:], to_srgb(0.5 * clear + 0.5 * air)[6:], atol=1e-5)


@pytest.mark.usefixtures("toys")
def test_a_row_is_scored_by_the_truth(scene, tmp_path):
    black = painted(scene, tmp_path / "black", lambda view: np.zeros_like(view.image()))
    cases = {"as it is": (scene, scene), "too bright": (scene, black), "black": (black, black)}
    score = {
        case: row("toy_methods:MeanColour", pair, "demo", 0, tmp_path / case)["PSNR"] for case, pair in cases.items()
    }
    assert score["too bright"] < score["as it is"] < 30 < score["black"]
