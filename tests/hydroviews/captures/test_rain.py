import re

import numpy as np
import pycolmap
import pytest
from captures import capture, flower_walk, rained_on

from hydroviews.captures.sfm import matching, rain
from hydroviews.captures.sfm.features import read_features
from hydroviews.captures.sfm.poses import estimate_poses
from hydroviews.errors import InputError
from hydroviews.formats.read import read_scene
from hydroviews.scene.images import read_image, resize_area, write_png


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


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Four photographs of the flower, two views apart each, in a folder, and their names."""
    folder, pictures = tmp_path_factory.mktemp("walk"), flower_walk()
    for i in range(4):
        write_png(folder / f"{i}.png", resize_area(pictures[2 * i][1], 240, 180))
    return folder, [f"{i}.png" for i in range(4)]


def detect(folder, names, database, enhance=None):
    """Features of photographs as they come into the database of matches."""
    matching.register(database, folder, names, "SIMPLE_PINHOLE", shared=True)
    rain.extract(database, folder, names, "SIMPLE_PINHOLE", 2.0, enhance=enhance)
    return read_features(database, names)


def test_where_there_are_no_drops_nothing_is_left_out(walk, tmp_path, caplog):
    folder, names = walk
    matching.register(tmp_path / "plain.db", folder, names, "SIMPLE_PINHOLE", shared=True)
    matching.extract(tmp_path / "plain.db", folder, names, "SIMPLE_PINHOLE")
    with caplog.at_level("INFO"):
        found = detect(folder, names, tmp_path / "d.db")
    assert re.search(r"\b0 of \d{3,} features stay", caplog.text)
    for one, plain in zip(found, read_features(tmp_path / "plain.db", names), strict=True):
        np.testing.assert_array_equal(one.keypoints, plain.keypoints)
        np.testing.assert_array_equal(one.descriptors, plain.descriptors)


def test_what_stays_in_one_place_of_the_lens_is_left_out(walk, tmp_path):
    folder, names = walk
    pattern = np.random.default_rng(0).random((30, 40, 3)).astype(np.float32).repeat(6, 0).repeat(6, 1)
    lens = np.zeros((180, 240, 1), bool)
    lens[20:80, 30:100] = lens[90:150, 120:220] = True
    for name in names:
        write_png(tmp_path / "wet" / name, np.where(lens, pattern, read_image(folder / name)))
    for name, one in zip(names, detect(tmp_path / "wet", names, tmp_path / "d.db"), strict=True):
        places = one.keypoints[:, :2].astype(int)
        inside = lens[places[:, 1], places[:, 0], 0]
        dry = read_features(tmp_path / "d.db.photographs", [name])[0]
        there = dry.keypoints[:, :2].astype(int)
        before = lens[there[:, 1], there[:, 0], 0]
        assert before.sum() > 50
        assert inside.sum() < 0.3 * before.sum()
        assert (~inside).sum() > 0.9 * (~before).sum()


def test_features_that_are_all_on_the_lens_are_an_error(walk, tmp_path):
    folder, names = walk
    for name in names:
        write_png(tmp_path / "still" / name, read_image(folder / names[0]))
    with pytest.raises(InputError, match=r"nothing moves from view to view\n.*in one place[\s\S]*wipe the lens"):
        detect(tmp_path / "still", names, tmp_path / "d.db")


def test_features_of_enhanced_photographs_come_beside_the_photographs_own(walk, tmp_path):
    folder, names = walk
    own = detect(folder, names, tmp_path / "own.db")
    both = detect(folder, names, tmp_path / "both.db", enhance=lambda image: np.ascontiguousarray(image[:, ::-1]))
    for one, more in zip(own, both, strict=True):
        np.testing.assert_array_equal(more.keypoints[: len(one)], one.keypoints)
        added = more.keypoints[len(one) :, :2]
        assert len(added) > 0.3 * len(one)
        apart = np.linalg.norm(added[:, None] - one.keypoints[:, :2], axis=-1)
        assert apart.min() > 1  # two of one place would both be no distinct match
    with pycolmap.Database.open(tmp_path / "both.db") as opened:
        assert opened.num_images() == len(names)
    detect(folder, names, tmp_path / "both.db", enhance=None)  # features that are there stay
    assert len(read_features(tmp_path / "both.db", names)[0]) == len(both[0])


def test_an_enhanced_photograph_of_another_size_is_named(walk, tmp_path):
    folder, names = walk
    with pytest.raises(InputError, match=r"0\.png: enhanced to another size\n.*\(179, .*\n.*\(180, "):
        detect(folder, names, tmp_path / "d.db", enhance=lambda image: image[1:])


def test_enhanced_pictures_need_rain(walk, tmp_path):
    with pytest.raises(ValueError, match="only where it is rainy"):
        estimate_poses(walk[0], tmp_path / "out", enhance=lambda image: image)


def test_rainy_photographs_with_enhanced_ones_get_cameras(walk, tmp_path):
    calls = []

    def enhance(image):
        calls.append(1)
        return image

    scene = estimate_poses(walk[0], tmp_path, rainy=True, enhance=enhance, features="sift")
    assert len(scene.views) == len(calls) == 4
    left = {path.name for path in tmp_path.iterdir() if not path.name.startswith(".")}
    assert left == {"images", "sparse", "database.db", "pairs.txt", "poses.json"}
    estimate_poses(walk[0], tmp_path, rainy=True, enhance=enhance)
    assert len(calls) == 4
    with pytest.raises(InputError, match=r"estimated otherwise\n.*enhanced"):
        estimate_poses(walk[0], tmp_path, rainy=True)


def test_small_photographs_have_smaller_tolerances():
    assert [rain.tolerance(side) for side in (100, 320, 800, 1200, 1600, 4000)] == [2, 2, 2, 3, 4, 4]
