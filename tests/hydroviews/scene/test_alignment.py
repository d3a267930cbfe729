import numpy as np
import pytest
from random_cameras import cameras, rotations, similarity

from hydroviews.errors import InputError
from hydroviews.scene.alignment import align, centres


@pytest.fixture
def generator():
    return np.random.default_rng(3)


SHAPES = {
    "in space": lambda g: g.normal(size=(12, 3)),
    "in a plane": lambda g: g.normal(size=(12, 3)) * (1, 1, 0),
    "on a line": lambda g: np.linspace(0, 1, 12)[:, None] * (1.0, 2.0, 3.0),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_a_known_similarity_is_found_again(shape, generator):
    poses = cameras(SHAPES[shape](generator), rotations(generator, 12))
    true = similarity(generator)
    found = align(poses, true.poses(poses))
    assert found.scale == pytest.approx(true.scale, rel=1e-9)
    np.testing.assert_allclose(found.rotation, true.rotation, atol=1e-9)
    np.testing.assert_allclose(found.translation, true.translation, atol=1e-8)


def test_poses_move_with_the_points_they_see(generator):
    poses, true = cameras(generator.normal(size=(5, 3)), rotations(generator, 5)), similarity(generator)
    points = generator.normal(size=(7, 3))
    seen = np.einsum("nij,pj->npi", poses[:, :3, :3], points) + poses[:, None, :3, 3]
    moved = true.poses(poses)
    again = np.einsum("nij,pj->npi", moved[:, :3, :3], true.points(points)) + moved[:, None, :3, 3]
    np.testing.assert_allclose(again, true.scale * seen, atol=1e-9)
    np.testing.assert_allclose(centres(moved), true.points(centres(poses)), atol=1e-9)
    np.testing.assert_allclose(true.inverse().points(true.points(points)), points, atol=1e-9)


def test_a_third_of_wrong_cameras_does_not_pull_at_the_others(generator):
    poses = cameras(generator.normal(size=(12, 3)), rotations(generator, 12))
    target = similarity(generator).poses(poses)
    target[:4, :3, 3] += 100 * generator.normal(size=(4, 3))
    left = np.linalg.norm(align(poses, target).points(centres(poses)) - centres(target), axis=1)
    assert left[4:].max() < 0.2 < 20 < left[:4].min()


@pytest.mark.parametrize("turned", [True, False], ids=["with their axes", "positions alone"])
def test_a_mirror_image_is_refused(turned, generator):
    positions, turns = generator.normal(size=(12, 3)), rotations(generator, 12)
    mirror = np.diag([1.0, 1.0, -1.0])
    mirrored = cameras(positions @ mirror, mirror @ turns @ mirror if turned else turns)
    with pytest.raises(InputError, match="mirror image"):
        align(mirrored, cameras(positions, turns))


def test_cameras_in_a_plane_are_not_taken_for_their_mirror_image(generator):
    """A plane is its own mirror image: with noise across it, either may fit better by chance."""
    for _ in range(20):
        poses = cameras(generator.normal(size=(12, 3)) * (1, 1, 0), rotations(generator, 12))
        noisy = poses.copy()
        noisy[:, :3, 3] += 1e-3 * generator.normal(size=(12, 3))
        assert np.linalg.det(align(poses, noisy).rotation) == pytest.approx(1)


@pytest.mark.parametrize("which", [0, 1], ids=["found", "true"])
def test_cameras_in_one_place_have_no_scale(which, generator):
    apart = cameras(generator.normal(size=(5, 3)), rotations(generator, 5))
    together = cameras(np.ones((5, 3)), rotations(generator, 5))
    with pytest.raises(InputError, match="in one place"):
        align(*((together, apart), (apart, together))[which])


def test_two_cameras_are_too_few(generator):
    poses = cameras(generator.normal(size=(2, 3)), rotations(generator, 2))
    with pytest.raises(InputError, match=r"2 cameras to align\n.*at least 3"):
        align(poses, poses)
