import numpy as np

from hydroviews.captures.sfm.features import Features
from hydroviews.captures.sfm.lens import ALIKE, LEAST, on_the_lens

RADIUS = 2.0


def features(random, count):
    places = random.uniform(0, 300, (count, 4)).astype(np.float32)
    return Features(places, random.integers(0, 255, (count, 128), np.uint8))


def together(one, other):
    both = (np.concatenate(pair) for pair in ((one.keypoints, other.keypoints), (one.descriptors, other.descriptors)))
    return Features(*both)


def moved(features, pixels):
    return Features(features.keypoints + np.float32([pixels, 0, 0, 0]), features.descriptors)


def test_features_that_recur_in_place_are_found_and_others_are_not():
    random = np.random.default_rng(0)
    drops, scene = features(random, 30), features(random, 200)
    views = [together(moved(drops, 0.3 * i), moved(scene, 7 * i)) for i in range(6)]  # up to 1.5 pixels, and 35
    for mask in on_the_lens(views, RADIUS):
        assert mask[:30].all()
        assert not mask[30:].any()


def test_the_same_place_needs_a_like_descriptor():
    random = np.random.default_rng(1)
    views = [features(random, 50) for _ in range(6)]
    views = [Features(views[0].keypoints, view.descriptors) for view in views]
    alike = [v.descriptors.astype(float) / np.linalg.norm(v.descriptors.astype(float), axis=1)[:, None] for v in views]
    assert (alike[0] * alike[1]).sum(1).max() < ALIKE + 0.1
    views = [Features(view.keypoints, np.eye(50, 128, i, dtype=np.uint8) * 255) for i, view in enumerate(views)]
    assert not any(mask.any() for mask in on_the_lens(views, RADIUS))


def test_a_share_of_the_views_is_needed_and_no_fewer_than_three():
    random = np.random.default_rng(2)
    drop = features(random, 1)
    for count, wet, left in ((LEAST, LEAST, False), (LEAST + 1, LEAST + 1, True), (40, 8, False), (40, 9, True)):
        views = [
            together(drop, moved(features(random, 5), 0)) if i < wet else features(random, 5) for i in range(count)
        ]
        assert on_the_lens(views, RADIUS)[0][0] == left


def test_one_view_and_views_without_features():
    none = Features(np.zeros((0, 4), np.float32), np.zeros((0, 128), np.uint8))
    one = features(np.random.default_rng(3), 5)
    assert [mask.tolist() for mask in on_the_lens([one], RADIUS)] == [[False] * 5]
    assert [len(mask) for mask in on_the_lens([none, one, none, one], RADIUS)] == [0, 5, 0, 5]
    assert [len(mask) for mask in on_the_lens([none, none], RADIUS)] == [0, 0]
