import re
import shutil
from unittest.mock import Mock

import numpy as np
import pycolmap
import pytest
from captures import flower_walk, rained_on

from hydroviews.captures.sfm import matching, rain
from hydroviews.captures.sfm.features import Features, read_features
from hydroviews.captures.sfm.lens import LEAST, on_the_lens
from hydroviews.captures.sfm.poses import estimate_poses
from hydroviews.errors import InputError
from hydroviews.scene.images import read_image, resize_area, write_png


@pytest.fixture
def features(tmp_path):
    """The database of features of three photographs in streaks, and one of something else; and their names."""
    pictures = [rained_on(image, i) for i, (_, image) in enumerate(flower_walk()[:3])]
    pictures.append(np.random.default_rng(0).random(pictures[0].shape).astype(np.float32))
    names = [f"{i}.png" for i in range(4)]
    for name, picture in zip(names, pictures, strict=True):
        write_png(tmp_path / name, picture)
    matching.register(tmp_path / "d.db", tmp_path, names, "SIMPLE_PINHOLE", shared=True)
    matching.extract(tmp_path / "d.db", tmp_path, names, "SIMPLE_PINHOLE")
    return tmp_path / "d.db", names


PAIRS = [(0, 1), (0, 2), (1, 2), (0, 3)]


def verified(database, names):
    """Verified matches of PAIRS, as indices of their features."""
    with pycolmap.Database.open(database) as opened:
        ids = [opened.read_image_with_name(name).image_id for name in names]
        return {(i, j): opened.read_two_view_geometry(ids[i], ids[j]).inlier_matches for i, j in PAIRS}


def test_guided_matching_of_pairs_that_share_something_goes_on_after_an_interruption(features, monkeypatch):
    database, names = features
    done = database.with_name("d.db.guided")
    monkeypatch.setattr(matching, "PAIRS_AT_ONCE", 1)
    shutil.copy(database, database.with_name("whole.db"))
    rain.match(database.with_name("whole.db"), names, PAIRS, 0, 2.0)
    whole = verified(database.with_name("whole.db"), names)
    assert len(whole[0, 3]) == 0  # they share nothing, and are not matched again
    assert database.with_name("whole.db.guided").read_text() == "0.png 1.png\n0.png 2.png\n1.png 2.png\n"

    forget, calls = rain._forget, []

    def stop_at_the_second(database, lines):
        forget(database, lines)
        calls.append(lines)
        if len(calls) == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(rain, "_forget", stop_at_the_second)
        rain.match(database, names, PAIRS, 0, 2.0)
    assert len(verified(database, names)[0, 2]) == 0
    rain.match(database, names, PAIRS, 0, 2.0)
    for pair, matches in verified(database, names).items():
        np.testing.assert_array_equal(matches, whole[pair])
    before = done.read_text()
    rain.match(database, names, PAIRS, 0, 2.0)
    assert done.read_text() == before


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
    found, plain = detect(folder, names, tmp_path / "d.db"), read_features(tmp_path / "plain.db", names)
    assert re.search(r"\b0 of \d{3,} features stay", caplog.text)
    for one, other in zip(found, plain, strict=True):
        np.testing.assert_array_equal(one.keypoints, other.keypoints)
        np.testing.assert_array_equal(one.descriptors, other.descriptors)


def test_what_stays_in_one_place_of_the_lens_is_left_out(walk, tmp_path):
    folder, names = walk
    pattern = np.random.default_rng(0).random((30, 40, 3)).astype(np.float32).repeat(6, 0).repeat(6, 1)
    lens = np.zeros((180, 240), bool)
    lens[20:80, 30:100] = lens[90:150, 120:220] = True
    for name in names:
        write_png(tmp_path / "wet" / name, np.where(lens[..., None], pattern, read_image(folder / name)))
    left = detect(tmp_path / "wet", names, tmp_path / "d.db")
    for found in zip(left, read_features(tmp_path / "d.db.detected", names), strict=True):
        after, before = (lens[tuple(one.keypoints[:, 1::-1].astype(int).T)] for one in found)
        assert before.sum() > 50
        assert after.sum() < 0.3 * before.sum()
        assert (~after).sum() > 0.9 * (~before).sum()


def test_features_that_are_all_on_the_lens_are_an_error(walk, tmp_path):
    folder, names = walk
    for name in names:
        write_png(tmp_path / "still" / name, read_image(folder / names[0]))
    with pytest.raises(InputError, match=r"nothing moves from view to view\n.*in one place[\s\S]*wipe the lens"):
        detect(tmp_path / "still", names, tmp_path / "d.db")


def test_features_are_those_of_enhanced_photographs(walk, tmp_path):
    folder, names = walk
    own = detect(folder, names, tmp_path / "own.db")
    enhanced = detect(folder, names, tmp_path / "both.db", enhance=lambda image: np.ascontiguousarray(image[:, ::-1]))
    for one, mirrored in zip(own, enhanced, strict=True):
        back = (240 - mirrored.keypoints[:, 0], mirrored.keypoints[:, 1])
        apart = np.hypot(*(a[:, None] - b for a, b in zip(back, one.keypoints[:, :2].T, strict=True)))
        assert np.median(apart.min(axis=1)) < 1
    detect(folder, names, tmp_path / "both.db", enhance=None)  # features that are there stay
    assert len(read_features(tmp_path / "both.db", names)[0]) == len(enhanced[0])


def test_rainy_photographs_with_enhanced_ones_get_cameras(walk, tmp_path):
    enhance = Mock(side_effect=lambda image: image)
    scene = estimate_poses(walk[0], tmp_path, rainy=True, enhance=enhance, features="sift")
    assert len(scene.views) == enhance.call_count == 4
    left = {path.name for path in tmp_path.glob("[!.]*")}
    assert left == {"images", "sparse", "database.db", "pairs.txt", "poses.json"}
    estimate_poses(walk[0], tmp_path, rainy=True, enhance=enhance)
    assert enhance.call_count == 4
    with pytest.raises(InputError, match=r"estimated otherwise\n.*enhanced"):
        estimate_poses(walk[0], tmp_path, rainy=True)


RADIUS = 2.0


def drawn(random, count):
    places = random.uniform(0, 300, (count, 4)).astype(np.float32)
    return Features(places, random.integers(0, 255, (count, 128), np.uint8))


def test_the_same_place_needs_a_like_descriptor():
    places = drawn(np.random.default_rng(1), 50).keypoints
    views = [Features(places, np.eye(50, 128, i, dtype=np.uint8) * 255) for i in range(6)]
    assert not any(mask.any() for mask in on_the_lens(views, RADIUS))


@pytest.mark.parametrize(
    ("count", "wet", "left"), [(LEAST, LEAST, False), (LEAST + 1, LEAST + 1, True), (40, 8, False), (40, 9, True)]
)
def test_a_share_of_the_views_is_needed_and_no_fewer_than_three(count, wet, left):
    """A drop, the first of six features, drifts by up to 1.5 pixels; the others are elsewhere in every view."""
    random = np.random.default_rng(2)
    drop, views = drawn(random, 1), [drawn(random, 6) for _ in range(count)]
    for i, view in enumerate(views[:wet]):
        view.keypoints[0], view.descriptors[0] = drop.keypoints[0] + [1.5 * i / count, 0, 0, 0], drop.descriptors[0]
    for mask in on_the_lens(views, RADIUS)[:wet]:
        assert mask.tolist() == [left, *[False] * 5]


def test_one_view_and_views_without_features():
    none = Features(np.zeros((0, 4), np.float32), np.zeros((0, 128), np.uint8))
    one = drawn(np.random.default_rng(3), 5)
    assert [mask.tolist() for mask in on_the_lens([one], RADIUS)] == [[False] * 5]
    assert [len(mask) for mask in on_the_lens([none, one, none, one], RADIUS)] == [0, 5, 0, 5]
    assert [len(mask) for mask in on_the_lens([none, none], RADIUS)] == [0, 0]
