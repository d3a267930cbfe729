import numpy as np
import pytest

from hydroviews.blender.embedded_scenes.camera_paths import place_cameras
from hydroviews.blender.embedded_scenes.foliage import blades, leaves, tree
from hydroviews.blender.embedded_scenes.market import EAVES, LENGTH, MARKET, WIDTH
from hydroviews.blender.embedded_scenes.market_things import GOODS, person, stall
from hydroviews.blender.embedded_scenes.meshes import Mesh, moved
from hydroviews.blender.embedded_scenes.pond import POND, WALK


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def areas(mesh: Mesh) -> np.ndarray:
    """Of quadrilaterals, by their diagonals."""
    corners = mesh.vertices[np.array(mesh.faces)]
    return np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1) / 2


def cameras(design, seed=0):
    return place_cameras(design.path, 40, 64, 48, seed)


def placed(pieces) -> np.ndarray:
    """All vertices [N, 3], where they stand."""
    return np.concatenate([moved(piece.mesh, piece.position, piece.turn).vertices for piece in pieces])


def test_leaves_are_flat_rhombi_about_their_places(rng):
    places = rng.uniform(-5, 5, (200, 3))
    corners = leaves(rng, places, 0.2).vertices.reshape(200, 4, 3)
    np.testing.assert_allclose(corners.mean(axis=1), places, atol=1e-12)
    along, across = corners[:, 2] - corners[:, 0], corners[:, 1] - corners[:, 3]
    np.testing.assert_allclose(np.sum(along * across, axis=1), 0, atol=1e-12)
    lengths = np.linalg.norm(along, axis=1)
    assert 0.7 * 0.2 <= lengths.min() < lengths.max() <= 1.2 * 0.2
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), 0.55 * lengths)


def test_blades_stand_on_their_feet_and_narrow_upwards(rng):
    feet = rng.uniform(-5, 5, (300, 3)) * (1, 1, 0)
    mesh = blades(rng, feet, 0.3, 0.02)
    lower, upper = mesh.vertices.reshape(2, 300, 4, 3)
    np.testing.assert_allclose(lower[:, :2].mean(axis=1), feet, atol=1e-12)
    np.testing.assert_allclose(lower[:, 2:].mean(axis=1), upper[:, :2].mean(axis=1), atol=1e-12)
    assert 0.3 * 0.6 - 1e-9 <= upper[:, 2:, 2].min() < upper[:, 2:, 2].max() <= 0.3 * 1.1 + 1e-9
    assert np.median(areas(mesh)[300:]) < np.median(areas(mesh)[:300])


def test_a_tree_carries_its_leaves_on_thin_branches_and_a_bare_one_none(rng):
    trunk, branches, crown = tree(rng, "oak", (0.0, 0.0, 0.0), 4.0, "foliage")
    assert crown.mesh.vertices[:, 2].min() > 0.5 * trunk.mesh.vertices[:, 2].max()
    assert 3.0 < branches.mesh.vertices[:, 2].max() < 6.0
    bare = list(tree(rng, "bare", (0.0, 0.0, 0.0), 4.0, "foliage", leaf=0.0))
    assert [piece.name for piece in bare] == ["bare trunk", "bare branches"]
    assert len(bare[1].mesh.faces) > 2 * len(branches.mesh.faces)


@pytest.mark.parametrize("goods", GOODS)
def test_goods_lie_on_their_stall_below_its_canopy(rng, goods):
    pieces = list(stall(rng, "stall", (0.0, 0.0, 0.0), 0.0, goods, "sailcloth"))
    laden = [piece for piece in pieces if piece.name.split()[1] not in ("posts", "table", "canopy")]
    assert len(laden) > 5
    low, high = placed(laden).min(axis=0), placed(laden).max(axis=0)
    assert np.all(low > (-1.3, -0.6, 0.78))  # ice lies in its tray, and the tray in the table
    assert np.all(high < (1.3, 0.65, 2.5))


def test_a_stall_that_is_turned_takes_its_goods_along():
    here, there = (
        placed(stall(np.random.default_rng(3), "stall", place, turn, "fish", "sailcloth"))
        for place, turn in (((0.0, 0.0, 0.0), 0.0), ((4.0, -2.0, 0.0), 0.7))
    )
    c, s = np.cos(0.7), np.sin(0.7)
    turned = here @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + (4.0, -2.0, 0.0)
    np.testing.assert_allclose(there, turned, atol=1e-9)


def test_people_are_as_tall_as_people_and_stand_on_the_floor(rng):
    for i in range(20):
        vertices = placed(person(rng, f"person {i}", (1.0, 2.0, 0.0), 0.4))
        assert -0.01 < vertices[:, 2].min() < 0.03
        assert 1.5 < vertices[:, 2].max() < 2.0
        assert np.abs(vertices[:, :2] - (1.0, 2.0)).max() < 0.6


def test_cameras_of_the_market_look_outward_all_around():
    middle = np.array(MARKET.path.target)
    ahead = []
    for camera in cameras(MARKET):
        _, depth = camera.project([middle])
        assert depth[0] < 0  # behind the camera
        ahead.append(camera.rotation[2])
        hall = np.array([LENGTH / 2, WIDTH / 2]) - 1
        assert np.all(np.abs(camera.centre[:2]) < hall)
        assert 1.0 < camera.centre[2] < EAVES - 2
    headings = np.sort(np.arctan2(*np.array(ahead)[:, 1::-1].T))
    assert np.diff(headings, append=headings[0] + 2 * np.pi).max() < np.radians(30)


def test_cameras_of_the_pond_walk_up_and_down_on_the_gravel():
    eyes = np.concatenate([[camera.centre for camera in cameras(POND, seed)] for seed in range(3)])
    distance = np.linalg.norm(eyes[:, :2], axis=1)
    assert np.all((distance > WALK[0]) & (distance < WALK[1]))
    assert np.ptp(eyes[:, 2]) > 1.0
