"""Captures that are hard for camera estimation: what registers, how well, and what is refused."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hydroviews.captures.sfm.mapping import TooFewRegistered
from hydroviews.captures.sfm.poses import estimate_poses
from hydroviews.dataset.sources import find_capture
from hydroviews.scene.camera_errors import compare_cameras
from hydroviews.scene.images import resize_area, write_png

VIEWS, WIDTH, HEIGHT = 6, 200, 150
DROPS, RADII, GREY = 60, (2, 6), 0.75


@pytest.fixture(scope="module")
def courtyard(tmp_path_factory):
    """Neighbouring views of the courtyard, and their small pictures."""
    views = find_capture("courtyard", tmp_path_factory.mktemp("courtyard"), 40, 320).views[6 : 6 + VIEWS]
    return views, [resize_area(view.image(), WIDTH, HEIGHT) for view in views]


def wet(image):
    """The picture behind grey drops, which are at the same places of every picture."""
    random, drops = np.random.default_rng(5), image.copy()
    sides = (random.integers(low, high, DROPS).tolist() for low, high in ((0, WIDTH), (0, HEIGHT), RADII))
    for x, y, radius in zip(*sides, strict=True):
        cv2.circle(drops, (x, y), radius, (GREY,) * 3, -1, cv2.LINE_AA)
    return drops


LEFT = np.arange(WIDTH)[:, None] < WIDTH // 2
CASES = {
    "drops on half of the lens": lambda pictures: [np.where(LEFT, wet(p), p) for p in pictures],
    "wiped half-way": lambda pictures: [wet(p) if i < VIEWS // 2 else p for i, p in enumerate(pictures)],
    "portrait and landscape": lambda pictures: [p[:, 43:-44] if i % 2 else p[18:-19] for i, p in enumerate(pictures)],
    "low contrast": lambda pictures: [0.8 + 0.15 * wet(p) for p in pictures],
    "three views": lambda pictures: [wet(p) for p in pictures[:3]],
}


def estimated(folder, pictures):
    for i, picture in enumerate(pictures):
        write_png(folder / "photographs" / f"{i}.png", picture.astype(np.float32))
    scene = estimate_poses(folder / "photographs", folder / "out", "SIMPLE_PINHOLE", rainy=True)
    return {view.name: view.camera.world_to_camera for view in scene.views}


@pytest.mark.parametrize("case", CASES)
def test_all_views_register_about_where_they_are(courtyard, tmp_path, case):
    views, pictures = courtyard
    painted = CASES[case](pictures)
    true = {str(i): view.camera.world_to_camera for i, view in enumerate(views[: len(painted)])}
    errors, _ = compare_cameras(estimated(tmp_path, painted), true)
    assert errors.registered == len(painted)
    assert errors.pose_auc_30 > 0.75


def test_a_view_without_detail_is_left_out(courtyard, tmp_path):
    pictures = courtyard[1][:4]
    assert sorted(estimated(tmp_path, [*pictures, np.full_like(pictures[0], GREY)])) == ["0", "1", "2", "3"]


def turned(image, degrees):
    """The picture after the camera has turned to the side at its place; unknown pixels are black."""
    lens = np.array([[0.72 * WIDTH, 0, WIDTH / 2], [0, 0.72 * WIDTH, HEIGHT / 2], [0, 0, 1]])
    turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    return cv2.warpPerspective(image, lens @ turn @ np.linalg.inv(lens), (WIDTH, HEIGHT))


def test_a_camera_that_only_turns_is_refused(courtyard, tmp_path):
    """Photographs of one place show no depth."""
    with pytest.raises(TooFewRegistered):
        estimated(tmp_path, [wet(turned(courtyard[1][0], 5 * i)) for i in range(4)])
