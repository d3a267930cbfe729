"""Mist on the lens: its kernels against the formula, what is learned of it, and what is expected."""

import numpy as np
import panorama
import pytest
from pretended_network import PretendedNetwork

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import photometric_loss, prepare_target
from baselines.training.images import TrainingImages
from deraings.lens.mist_prior import NetworkMist
from deraings.lens.paleness import mist_evidence
from deraings.rain_model.config import MistConfig
from deraings.rain_model.kernels import add_mist, mist_gradient
from deraings.rain_model.mist import MOST_ALPHA, NOISE, Mist, MistGradient, difference_gradient, spreading
from hydroviews.scene.images import to_linear, to_srgb

AIR = np.array([0.55, 0.6, 0.65], np.float32)
STEPS, COUNT = 400, 10
SIZE = panorama.HEIGHT, panorama.WIDTH


@pytest.fixture(scope="module")
def scene():
    return panorama.views_of(panorama.paint(), COUNT)


@pytest.fixture(scope="module")
def pictures(scene):
    return panorama.eight_bit(panorama.misted(scene, panorama.slanted_mist(0.4), AIR))


def mist_of(pictures, config=None, steps=STEPS, hidden=(), **network):
    return Mist(mist_evidence(TrainingImages(pictures, hidden)), steps, config or MistConfig(), **network)


def learn(scene, photographs, config=None, steps=STEPS, **sources):
    """Fit mist to photographs of a known scene."""
    pictures = panorama.eight_bit(photographs)
    mist, buffers = mist_of(pictures, config, steps, **sources), BufferPool()
    targets = [prepare_target(picture) for picture in pictures]
    for step in range(steps):
        view = step % len(scene)
        root = mist.spread(mist.knots(view), SIZE)
        seen = mist.forward(scene[view], root, buffers.array("misted", scene[view].shape))
        _, gradient = photometric_loss(seen, targets[view], buffers=buffers)
        _, by_mist = mist.backward(scene[view], seen, root, view, gradient, gradient, buffers)
        mist.update(by_mist, step)
    return mist


def push(mist, by_roots=0.0, by_colour=0.0, iteration=0):
    """One step of a gradient that is alike everywhere, without priors."""
    mist.update(MistGradient(np.full_like(mist.roots, by_roots), np.full(3, by_colour, np.float32)), iteration)


def test_mist_converges_to_the_truth_from_whatever_was_expected(scene):
    true = panorama.slanted_mist(0.4)
    for predicted in (None, 0.4):
        light = np.full((16, 16), (predicted or 0) * AIR.mean(), np.float32)
        mist = None if predicted is None else NetworkMist(light, light)
        network = PretendedNetwork(mist=mist).lens_mist
        found = learn(scene, panorama.misted(scene, true, AIR), network=network).alpha(0, SIZE)
        assert np.sqrt(np.mean((found - true) ** 2)) < 0.06
        assert np.corrcoef(found.ravel(), true.ravel())[0, 1] > 0.95


@pytest.mark.parametrize("paler", [0.0, 0.5])
def test_dry_views_and_fog_in_the_scene_have_next_to_none(paler):
    scene = panorama.views_of(panorama.paint() * (1 - paler) + 0.7 * paler, COUNT)
    assert learn(scene, scene).alpha(0, SIZE).mean() < 0.02


@pytest.mark.parametrize("start", [0.05, 0.3])
def test_the_prior_pulls_even_mist_of_which_photographs_show_nothing(scene, start):
    """Even mist is as good as a scene of less contrast: the loss has no gradient by it."""
    pictures = panorama.eight_bit(panorama.misted(scene, np.full(SIZE, 0.4), AIR))
    mist = mist_of(pictures)
    even = np.full_like(mist.roots, 0.15)
    mist.prior = mist.prior._replace(mean=even, deviation=np.full_like(even, 0.03))
    mist.roots[:] = np.sqrt(start)
    for step in range(STEPS):
        mist.update(mist.with_priors(step % COUNT, np.zeros_like(mist.knots(0)), np.zeros(3, np.float32)), step)
    assert np.square(mist.roots) == pytest.approx(0.15, abs=0.03)


def test_what_a_network_leaves_of_the_mist_and_what_it_takes_away_are_all_of_the_mist(scene, pictures):
    mist = mist_of(pictures)
    mist.roots[:] = np.sqrt(0.3)
    seen = mist.forward(scene[0], mist.spread(mist.knots(0), SIZE), np.empty_like(scene[0]))
    mist.prior = mist.prior._replace(removed=np.full_like(mist.roots, 0.1))
    left = mist.forward(scene[0], mist.spread(mist.left_knots(0), SIZE), np.empty_like(scene[0]))
    both = add_mist(left, np.full(SIZE, 0.1, np.float32), mist.colour, np.empty_like(left))
    assert both == pytest.approx(seen, abs=1e-4)
    mist.prior = mist.prior._replace(removed=np.full_like(mist.roots, 0.4))
    assert not mist.left_knots(0).any()


def test_the_gradient_of_prior_and_roughness_agrees_with_differences(pictures):
    """The prior has heavy tails: photographs may show far more or less mist in a place."""
    config = MistConfig(prior=2e-3)
    mist, rng = mist_of(pictures, config), np.random.default_rng(0)
    mist.roots[:] = rng.uniform(0.2, 0.7, mist.roots.shape)
    mean, deviation = mist.prior.mean.astype(np.float64), mist.prior.deviation.astype(np.float64)

    def penalty(roots):
        prior = np.log1p(((roots**2 - mean) / deviation) ** 2).mean()
        rough = sum((np.diff(roots, axis=axis) ** 2).sum() for axis in range(3)) / 2 / roots[0].size
        return config.prior * prior + config.roughness * rough

    roots, direction = mist.roots.astype(np.float64), rng.standard_normal(mist.roots.shape)
    expected = (penalty(roots + 1e-6 * direction) - penalty(roots - 1e-6 * direction)) / 2e-6
    found = mist.with_priors(0, np.zeros_like(mist.knots(0)), np.zeros(3, np.float32)).roots
    assert float((found * direction).sum()) == pytest.approx(expected, rel=1e-3)


def test_the_light_of_mist_is_held_near_what_is_expected_and_its_tint_more_loosely(pictures):
    mist = mist_of(pictures)
    pulls = []
    for shift in (np.full(3, 0.1), np.array([0.1, 0, -0.1])):
        mist.colour[:] = mist.expected + shift.astype(np.float32)
        pulls.append(mist.with_priors(0, np.zeros_like(mist.knots(0)), np.zeros(3, np.float32)).colour)
    assert (pulls[0] > 0).all()
    assert pulls[1] == pytest.approx(pulls[1][0] * np.array([1, 0, -1]), abs=1e-6)
    assert 0 < pulls[1][0] < pulls[0][0]


def test_the_tint_of_thin_mist_is_learned(scene):
    warm = AIR * np.array([1.2, 1.0, 0.7], np.float32)
    mist = learn(scene, panorama.misted(scene, panorama.slanted_mist(0.1), warm))
    assert mist.colour / mist.colour.mean() == pytest.approx(warm / warm.mean(), abs=0.04)


def test_mist_stays_within_what_photographs_allow(pictures):
    config = MistConfig(slack=1.0)
    mist = mist_of(pictures, config)
    for step in range(200):
        push(mist, by_roots=-1.0, by_colour=-1.0, iteration=step)
    alpha = mist.alpha(0, SIZE)
    assert alpha[:, :6].mean() < 0.25 < alpha[:, -6:].mean()  # what is dark there is seen through next to none
    assert alpha.max() <= MOST_ALPHA
    assert mist.colour.max() <= 1
    for step in range(400):
        push(mist, by_roots=1.0, iteration=step)
    assert mist.roots.max() == 0


def test_mist_that_drifts_is_followed():
    scene = panorama.views_of(panorama.paint(), 24)
    first, last = panorama.slanted_mist(0.4), panorama.slanted_mist(0.4)[:, ::-1]
    photographs = np.concatenate(
        [panorama.misted(scene[i : i + 1], first + (last - first) * i / 23, AIR) for i in range(24)]
    )
    mist = learn(scene, photographs, MistConfig(roughness=0.005), steps=600)
    left, right = (slice(None), slice(0, 12)), (slice(None), slice(-12, None))
    early, late = mist.alpha(0, SIZE), mist.alpha(23, SIZE)
    assert early[right].mean() > 2 * early[left].mean()
    assert late[left].mean() > 2 * late[right].mean()


def test_a_picture_that_is_all_mist_stays_finite():
    white = np.ones((3, *SIZE, 3), np.float32)
    mist = learn(white, white, steps=60)
    assert np.isfinite(mist.alpha(0, SIZE)).all()
    assert np.isfinite(mist.colour).all()
    assert mist.alpha(0, SIZE).max() <= MOST_ALPHA + 1e-6


def test_knots_are_spread_linearly_with_the_outermost_on_the_edge():
    spread = spreading(5, 2) @ np.array([[0, 1], [2, 3]]) @ spreading(3, 2).T
    expected = 2 * (np.arange(5)[:, None] + 0.5) / 5 + (np.arange(3) + 0.5) / 3
    assert spread == pytest.approx(expected, abs=1e-6)


def test_the_gradient_of_differences_is_the_sign_and_weighed():
    seen, photograph = np.full((2, 3, 3), 0.5, np.float32), np.full((2, 3, 3), 0.5, np.float32)
    photograph[0, 0], photograph[0, 1], photograph[0, 2] = 0.3, 0.9, 0.5 + NOISE / 2
    weights = np.float32([[1, 0.5, 1], [1, 1, 0]])
    found = difference_gradient(seen, photograph, weights) * seen.size
    assert found[..., 0] == pytest.approx(np.float32([[1, -0.5, -0.5], [0, 0, 0]]), abs=1e-5)
    assert difference_gradient(seen, photograph, None)[0, 1] * seen.size == pytest.approx([-1, -1, -1])


SHAPE = 13, 17, 3
COLOUR = np.array([0.7, 0.75, 0.8], np.float32)


@pytest.fixture
def picture():
    rng = np.random.default_rng(0)
    return rng.uniform(0, 1, SHAPE).astype(np.float32), rng.uniform(0.05, 0.9, SHAPE[:2]).astype(np.float32)


def exact(image, alpha, colour):
    return to_srgb(to_linear(image) * (1 - alpha[..., None]) + alpha[..., None] * colour)


def test_the_curve_is_that_of_srgb_from_black_to_beyond_white():
    """Decoded and encoded again, and light alone: every value of a picture as to_srgb and to_linear have it."""
    values = np.concatenate([np.linspace(0, 0.08, 3001), np.linspace(0.08, 1.8, 3000)]).astype(np.float32)
    image = np.repeat(values[None, :, None], 3, axis=2)
    for alpha in (1e-6, 0.05, 0.9):
        plane = np.full(image.shape[:2], alpha, np.float32)
        out = add_mist(image, plane, COLOUR, np.empty_like(image)).astype(np.float64)
        wide = image.astype(np.float64)
        light = np.where(wide <= 0.04045, wide / 12.92, ((wide + 0.055) / 1.055) ** 2.4) * (1 - alpha) + alpha * COLOUR
        expected = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        assert np.abs(out - expected).max() < 1e-5


def test_no_mist_leaves_the_very_same_pixels(picture):
    image, alpha = picture
    out = add_mist(image * 3, np.zeros_like(alpha), COLOUR, np.empty_like(image))
    assert np.array_equal(out, image * 3)


def test_gradients_agree_with_differences(picture):
    image, alpha = picture
    image = 0.05 + 0.9 * image  # away from the kink of the curve
    toward = np.random.default_rng(1).standard_normal(SHAPE).astype(np.float32)
    misted = add_mist(image, alpha, COLOUR, np.empty_like(image))
    told = np.random.default_rng(3).standard_normal(SHAPE).astype(np.float32)
    g_image, g_alpha, g_colour = mist_gradient(image, misted, alpha, COLOUR, toward, told, BufferPool())
    step = 1e-3

    def change(toward, **moved):
        values = {"image": image, "alpha": alpha, "colour": COLOUR}
        up = exact(**{**values, **{k: values[k] + step * d for k, d in moved.items()}})
        down = exact(**{**values, **{k: values[k] - step * d for k, d in moved.items()}})
        return float(((up.astype(np.float64) - down) / (2 * step) * toward).sum())

    rng = np.random.default_rng(2)
    for name, gradient, given in (("image", g_image, toward), ("alpha", g_alpha, told), ("colour", g_colour, told)):
        direction = rng.choice([-1.0, 1.0], gradient.shape).astype(np.float32)
        assert change(given, **{name: direction}) == pytest.approx(
            float((gradient * direction).sum()), rel=0.02, abs=0.05
        )


def test_pixels_brighter_than_white_stay_finite():
    image = np.full((2, 2, 3), 9.0, np.float32)
    alpha = np.full((2, 2), 0.5, np.float32)
    out = add_mist(image, alpha, COLOUR, np.empty_like(image))
    g_image, g_alpha, _ = mist_gradient(image, out, alpha, COLOUR, *(2 * [np.ones_like(image)]), BufferPool())
    assert np.isfinite(out).all()
    assert np.isfinite(g_image).all()
    assert np.isfinite(g_alpha).all()
