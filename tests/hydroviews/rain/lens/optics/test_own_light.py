from dataclasses import replace

import numpy as np
import pytest

from hydroviews.rain.lens.optics.own_light import GLARE, OwnLight, SkyEdge, tilted
from hydroviews.rain.lens.optics.path_matte import PathMatte, assemble, defocus, dry
from hydroviews.rain.lens.patterns.window import draw_window
from hydroviews.scene.images import to_linear

PATTERN = replace(draw_window(np.random.default_rng(0), 1), tilt=0.0, uneven=0.0)
EDGE = SkyEdge((0.0, -1.0), 0.1, 0.1, (100.0, 100.0))


def test_paths_that_turn_upwards_are_bright_wherever_they_are():
    pixel = np.array([0, 5, 99 * 100 + 50])
    middle = np.column_stack([pixel % 100 + 0.5, pixel // 100 + 0.5])
    for down, share in ((-40, 1), (40, 0), (-10, 0.5)):
        assert EDGE.share(pixel, middle + np.array([0, down]), 100) == pytest.approx([share] * 3)


def test_paths_that_end_nowhere_are_dark():
    traced = {
        "cover": np.ones((2, 2)),
        "pixel": np.array([0, 0, 3]),
        "place": np.array([[0.5, -90.0], [0.5, -90.0], [1.5, 90.0]]),
        "throughput": np.array([0.25, 0.25, 0.5]),
    }
    assert EDGE.plane(traced).tolist() == [[0.5, 0], [0, 0]]


def test_own_light_mixes_bright_and_dark():
    light = OwnLight(PATTERN, 4, 3)
    bright, dark = to_linear(np.array([PATTERN.bright, PATTERN.dark], np.float32))
    mask, sky = np.full((3, 4), 0.8, np.float32), np.full((3, 4), 0.3, np.float32)
    assert np.allclose(light.radiance(mask, sky), 0.3 * bright + 0.5 * dark)
    glaring = OwnLight(replace(PATTERN, tilt=0.03), 4, 3)
    assert np.allclose(glaring.radiance(mask, mask), 0.8 * GLARE * bright)


def test_a_tilted_pane_is_sharp_on_one_side_and_blurred_on_the_other():
    points = np.zeros((60, 80), np.float32)
    points[30, ::10] = 1
    (seen,) = tilted([points], replace(PATTERN, tilt=0.1, tilt_direction=0.0))
    assert seen[30, [0, 10]] == pytest.approx(1)
    assert seen[30, 70] < 0.2
    far = defocus(points, 0.1 * np.sqrt(60 * 80))
    assert seen[30, 79] == pytest.approx(far[30, 79], abs=0.02)
    assert tilted([points], PATTERN)[0] is points


def test_a_mattes_bright_part_is_kept(tmp_path):
    cover, sky = np.full((4, 4), 0.5), np.full((4, 4), 0.2, np.float32)
    matte = assemble(cover, np.arange(16), np.full((16, 2), 2.2), np.full(16, 0.5), 0.0, sky)
    matte.save(tmp_path / "matte.npz", "key")
    loaded, _ = PathMatte.load(tmp_path / "matte.npz")
    assert loaded.sky is not None
    assert np.array_equal(loaded.sky, sky)
    assert loaded.paths.sum() == pytest.approx(0.5 * 18)  # six of sixteen paths, three times as strong
    dry(4, 4).save(tmp_path / "lens.npz", "key")
    assert PathMatte.load(tmp_path / "lens.npz")[0].sky is None
