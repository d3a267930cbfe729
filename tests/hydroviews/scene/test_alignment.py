import numpy as np
import pytest
from random_cameras import cameras, rotations, similarity

from hydroviews.errors import InputError
from hydroviews.scene.alignment import align, centres
from hydroviews.scene.camera_errors import (
    angles,
    area_under_curve,
    compare_cameras,
    pair_errors,
    position_errors,
    rotation_errors,
)


@pytest.fixture
def generator():
    return np.random.default_rng(3)


def drawn(generator, count, extents=(1, 1, 1)):
    """World-to-camera poses at random places, in a box of those extents, and turns."""
    return cameras(generator.normal(size=(count, 3)) * extents, rotations(generator, count))


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
    poses, true = drawn(generator, 5), similarity(generator)
    points = generator.normal(size=(7, 3))
    seen = np.einsum("nij,pj->npi", poses[:, :3, :3], points) + poses[:, None, :3, 3]
    moved = true.poses(poses)
    again = np.einsum("nij,pj->npi", moved[:, :3, :3], true.points(points)) + moved[:, None, :3, 3]
    np.testing.assert_allclose(again, true.scale * seen, atol=1e-9)
    np.testing.assert_allclose(centres(moved), true.points(centres(poses)), atol=1e-9)
    np.testing.assert_allclose(true.inverse().points(true.points(points)), points, atol=1e-9)


def test_a_third_of_wrong_cameras_does_not_pull_at_the_others(generator):
    poses = drawn(generator, 12)
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
        poses = drawn(generator, 12, (1, 1, 0))
        noisy = poses.copy()
        noisy[:, :3, 3] += 1e-3 * generator.normal(size=(12, 3))
        assert np.linalg.det(align(poses, noisy).rotation) == pytest.approx(1)


@pytest.mark.parametrize("which", [0, 1], ids=["found", "true"])
def test_cameras_in_one_place_have_no_scale(which, generator):
    apart = drawn(generator, 5)
    together = cameras(np.ones((5, 3)), rotations(generator, 5))
    with pytest.raises(InputError, match="in one place"):
        align(*((together, apart), (apart, together))[which])


def test_two_cameras_are_too_few(generator):
    poses = drawn(generator, 2)
    with pytest.raises(InputError, match=r"2 cameras to align\n.*at least 3"):
        align(poses, poses)


def about_z(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


@pytest.mark.parametrize("degrees", [0, 1e-7, 0.3, 90, 179.9, 180])
def test_angles_are_those_turned_by(degrees):
    assert angles(about_z(degrees)) == pytest.approx(degrees, rel=1e-6, abs=1e-12)


def test_area_is_that_of_the_step_function():
    """Two of four pairs found, off by 1 and 4: the share is 1/4 from 1 on and 1/2 from 4 on."""
    errors = np.array([1.0, 4.0])
    assert area_under_curve(errors, 4, (5, 2)) == pytest.approx([(3 * 0.25 + 1 * 0.5) / 5, 0.25 / 2])
    assert area_under_curve(np.zeros(6), 6, (5,)) == [1]
    assert area_under_curve(np.zeros(0), 6, (5,)) == [0]
    with pytest.raises(ValueError, match="7 errors of 6"):
        area_under_curve(np.zeros(7), 6, (5,))


def test_relative_poses_know_nothing_of_the_world(generator):
    poses = drawn(generator, 6)
    errors = pair_errors(similarity(generator).poses(poses), poses)
    assert errors.shape == (15,)
    assert errors.max() < 1e-6


def test_the_worse_of_rotation_and_direction_counts():
    poses = cameras(np.array([[0, 0, 0], [1, 0, 0], [3.0, 0, 0]]), np.tile(np.eye(3), (3, 1, 1)))
    turned = poses.copy()
    turned[2] = np.block([[about_z(7), np.zeros((3, 1))], [0, 0, 0, 1]]) @ poses[2]  # where it is
    assert pair_errors(turned, poses) == pytest.approx([0, 7, 7])
    moved = cameras(np.array([[0, 0, 0], [0, 1, 0], [3.0, 0, 0]]), np.tile(np.eye(3), (3, 1, 1)))
    assert pair_errors(moved, poses) == pytest.approx([90, 0, np.degrees(np.arctan2(1, 3))])


def test_errors_of_one_world(generator):
    positions, turns = generator.normal(size=(5, 3)), rotations(generator, 5)
    poses = cameras(positions, turns)
    extent = np.sqrt(((positions - positions.mean(0)) ** 2).sum(1).mean())
    moved = cameras(positions + np.array([0.3, 0, 0]), about_z(11) @ turns)
    assert rotation_errors(moved, poses) == pytest.approx(np.full(5, 11))
    assert position_errors(moved, poses) == pytest.approx(np.full(5, 0.3 / extent))


def by_name(generator, count):
    """True cameras by name."""
    return {f"{i:02d}": pose for i, pose in enumerate(drawn(generator, count))}


def test_what_is_not_registered_counts_as_wrong(generator):
    """3 of 40: three pairs of 780."""
    true, world = by_name(generator, 40), similarity(generator)
    found = {name: world.poses(true[name]) for name in ("03", "17", "21")}
    errors, to_true = compare_cameras(found, true)
    assert (errors.registered, errors.photographs) == (3, 40)
    assert errors.pose_auc_5 == pytest.approx(3 / 780)
    assert errors.rotation_error == pytest.approx(0, abs=1e-6)
    assert errors.position_error == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(to_true.poses(found["17"]), true["17"], atol=1e-8)


def test_two_of_many_are_counted_and_not_aligned(generator):
    true = by_name(generator, 5)
    errors, to_true = compare_cameras({name: true[name] for name in ("01", "02")}, true)
    assert (errors.registered, errors.rotation_error, to_true) == (2, None, None)
    assert errors.pose_auc_30 == pytest.approx(0.1)
    assert compare_cameras({}, true)[0].pose_auc_30 == 0
    with pytest.raises(InputError, match=r"not in the scene\n.*9"):
        compare_cameras({"9": true["01"]}, true)
