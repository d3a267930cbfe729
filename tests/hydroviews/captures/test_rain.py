import numpy as np
import pycolmap
import pytest
from captures import capture, flower_walk, rained_on

from hydroviews.captures.sfm import matching, rain
from hydroviews.formats.read import read_scene
from hydroviews.scene.images import write_png


@pytest.fixture
def features(tmp_path):
    """The database of features of three photographs in streaks, and one of something else; and their names."""
    walk = [image for _, image in flower_walk()]
    pictures = [rained_on(walk[i], i) for i in (0, 1, 2)]
    pictures.append(np.random.default_rng(0).random(pictures[0].shape).astype(np.float32))
    names = [f"{i}.png" for i in range(4)]
    for name, picture in zip(names, pictures, strict=True):
        write_png(tmp_path / name, picture)
    matching.register(tmp_path / "d.db", tmp_path, names, "SIMPLE_PINHOLE", shared=True)
    matching.extract(tmp_path / "d.db", tmp_path, names, "SIMPLE_PINHOLE")
    return tmp_path / "d.db", names


def verified(database, names, one=0, other=1):
    """Verified matches between two of the photographs, as indices of their features."""
    with pycolmap.Database.open(database) as opened:
        ids = [opened.read_image_with_name(names[i]).image_id for i in (one, other)]
        return opened.read_two_view_geometry(*ids).inlier_matches


PAIRS = [(0, 1), (0, 2), (1, 2), (0, 3)]


def test_rain_leaves_enough_matches(tmp_path):
    """Two photographs in streaks: looser matches, and more of them near the epipolar lines, are more right ones."""
    solved = read_scene(capture("llff_flower"))
    (name, first), (other, second) = flower_walk()[0], flower_walk()[2]
    names = ["a.png", "b.png"]
    for i, image in enumerate((first, second)):
        write_png(tmp_path / names[i], rained_on(image, i))
    views = {view.name: view.camera.resized(400, 300) for view in solved.views}
    counts = {}
    for rainy in (False, True):
        database = tmp_path / f"{rainy}.db"
        matching.register(database, tmp_path, names, "SIMPLE_PINHOLE", shared=True)
        matching.extract(database, tmp_path, names, "SIMPLE_PINHOLE")
        rain.match(database, names, [(0, 1)], 0, 2.0) if rainy else matching.match(database, names, [(0, 1)], 0)
        with pycolmap.Database.open(database) as opened:
            ids = [opened.read_image_with_name(one).image_id for one in names]
            found = opened.read_two_view_geometry(*ids).inlier_matches
            points = [opened.read_keypoints(image)[:, :2] for image in ids]
        off = epipolar_distances(views[name], views[other], points[0][found[:, 0]], points[1][found[:, 1]])
        counts[rainy] = (off < 2).sum(), (off >= 2).sum()
    assert counts[True][0] > 1.5 * counts[False][0]
    assert counts[True][1] < counts[True][0]


def epipolar_distances(first, second, points, others):
    """Pixels between points [N, 2] of the second picture and the lines of those of the first."""
    turn = second.rotation @ first.rotation.T
    x, y, z = second.world_to_camera[:3, 3] - turn @ first.world_to_camera[:3, 3]
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn
    fundamental = np.linalg.inv(second.matrix).T @ essential @ np.linalg.inv(first.matrix)
    lines = np.column_stack([points, np.ones(len(points))]) @ fundamental.T
    offsets = (lines * np.column_stack([others, np.ones(len(others))])).sum(1)
    return np.abs(offsets) / np.linalg.norm(lines[:, :2], axis=1)


def test_pairs_that_share_nothing_are_not_matched_again(features):
    database, names = features
    rain.match(database, names, PAIRS, 0, 2.0)
    assert len(verified(database, names, 0, 3)) == 0
    assert (database.parent / "d.db.guided").read_text() == "0.png 1.png\n0.png 2.png\n1.png 2.png\n"


def test_interrupted_guided_matching_goes_on(features, monkeypatch):
    database, names = features
    monkeypatch.setattr(matching, "PAIRS_AT_ONCE", 1)
    whole = database.with_name("whole.db")
    whole.write_bytes(database.read_bytes())
    rain.match(whole, names, PAIRS, 0, 2.0)

    forget, calls = rain._forget, []

    def stop_at_the_second(database, lines):
        forget(database, lines)
        calls.append(lines)
        if len(calls) == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(rain, "_forget", stop_at_the_second)
        with pytest.raises(KeyboardInterrupt):
            rain.match(database, names, PAIRS, 0, 2.0)
    assert len(verified(database, names, 0, 2)) == 0
    rain.match(database, names, PAIRS, 0, 2.0)
    for one, other in PAIRS:
        np.testing.assert_array_equal(verified(database, names, one, other), verified(whole, names, one, other))
    done = (database.parent / "d.db.guided").read_text()
    rain.match(database, names, PAIRS, 0, 2.0)
    assert (database.parent / "d.db.guided").read_text() == done


def test_what_stays_in_one_place_of_the_lens_is_left_out(tmp_path):
    """Two photographs that have a pattern on the lens in common, and nothing else."""
    random = np.random.default_rng(0)
    lens = np.zeros((240, 320), bool)
    pattern = random.random((240, 320, 3)).astype(np.float32)
    lens[40:120, 60:160] = lens[150:220, 200:300] = True
    names = ["a.png", "b.png"]
    for name in names:
        other = np.repeat(np.repeat(random.random((60, 80, 3)), 4, 0), 4, 1).astype(np.float32)
        write_png(tmp_path / name, np.where(lens[..., None], pattern, other))
    for rainy in (False, True):
        database = tmp_path / f"{rainy}.db"
        matching.register(database, tmp_path, names, "SIMPLE_PINHOLE", shared=True)
        matching.extract(database, tmp_path, names, "SIMPLE_PINHOLE")
        rain.match(database, names, [(0, 1)], 0, 2.0) if rainy else matching.match(database, names, [(0, 1)], 0)
        count = len(verified(database, names))
        assert count == 0 if rainy else count > rain.MIN_MATCHES


def test_small_photographs_have_smaller_tolerances():
    assert [rain.tolerance(side) for side in (100, 320, 800, 1200, 1600, 4000)] == [2, 2, 2, 3, 4, 4]
