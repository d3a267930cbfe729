import cv2
import numpy as np
import panorama
import pytest

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import photometric_loss, prepare_target
from deraings.rain_model.mist import Mist, MistConfig, MistGradient, roughness_gradient, spreading
from deraings.rain_model.mist_bounds import MAX_PICTURES, max_mist_alpha, mist_bounds

AIR = np.array([0.55, 0.6, 0.65], np.float32)
STEPS = 400


def learn(scene, photographs, config=None, steps=STEPS):
    """Fit mist to photographs of a known scene."""
    pictures = panorama.eight_bit(photographs)
    mist, buffers = Mist(pictures, steps, config or MistConfig(start=0)), BufferPool()
    targets = [prepare_target(picture) for picture in pictures]
    for step in range(steps):
        view = step % len(scene)
        root = mist.root(view, scene[view].shape[:2])
        seen = mist.forward(scene[view], root, buffers.array("misted", scene[view].shape))
        _, gradient = photometric_loss(seen, targets[view], buffers=buffers)
        _, by_mist = mist.backward(scene[view], seen, root, view, gradient, gradient, buffers)
        mist.update(by_mist, step)
    return mist


def alpha_of(mist, view=0):
    return mist.alpha(view, (panorama.HEIGHT, panorama.WIDTH))


def test_mist_is_found():
    scene = panorama.views_of(panorama.paint(), 10)
    true = panorama.slanted_mist(0.4)
    mist = learn(scene, panorama.misted(scene, true, AIR))
    assert np.sqrt(np.mean((alpha_of(mist) - true) ** 2)) < 0.05
    assert np.corrcoef(alpha_of(mist).ravel(), true.ravel())[0, 1] > 0.95


def behind_beads(photographs):
    """Photographs behind dark and bright drops of two pixels, each as it is in all views, on a ninth of the lens."""
    wet = photographs.copy()
    for shade, start in ((0.02, 2), (1.0, 5)):
        for down, across in ((0, 0), (0, 1), (1, 0), (1, 1)):
            wet[:, start + down :: 8, start + across :: 8] = shade
    return wet


def test_drops_with_light_of_their_own_say_nothing_of_mist():
    scene = panorama.views_of(panorama.paint(), 24)
    photographs = panorama.misted(scene, panorama.slanted_mist(0.4), AIR)
    dry, wet = (
        mist_bounds(panorama.eight_bit(views), MistConfig()) for views in (photographs, behind_beads(photographs))
    )
    assert wet.mostly
    assert np.abs(wet.colour - dry.colour).max() < 0.05
    assert np.abs(wet.max_alpha - dry.max_alpha).mean() < 0.05
    assert np.corrcoef(wet.max_alpha.ravel(), dry.max_alpha.ravel())[0, 1] > 0.95


def test_mist_on_a_third_of_the_lens_is_enough_to_ask_points():
    scene = panorama.views_of(panorama.paint(), 24)
    mist = panorama.slanted_mist(0.4)
    mist = np.where(mist > 0.27, mist, 0).astype(np.float32)
    bounds = mist_bounds(panorama.eight_bit(panorama.misted(scene, mist, AIR)), MistConfig())
    assert bounds.partly
    assert not bounds.mostly


def test_places_under_drops_and_beside_them_are_not_dry():
    scene = panorama.views_of(panorama.paint(), 24)
    scene[:, 20:24, 30:34] = 0.02
    bounds = mist_bounds(panorama.eight_bit(scene), MistConfig())
    places = np.array([[32, 22], [35, 22], [10, 10]], np.float32) / (panorama.WIDTH, panorama.HEIGHT)
    assert bounds.dry_at(0, places.astype(np.float32)).tolist() == [False, False, True]


@pytest.mark.parametrize("paler", [0.0, 0.5])
def test_dry_views_and_fog_in_the_scene_have_none(paler):
    scene = panorama.views_of(panorama.paint() * (1 - paler) + 0.7 * paler, 10)
    assert alpha_of(learn(scene, scene)).max() < 0.01


def test_where_every_place_of_the_lens_shows_something_dark_no_mist_is_looked_for():
    scene = panorama.views_of(panorama.paint(), 8)
    mist = Mist(panorama.eight_bit(scene), STEPS, MistConfig(start=0))
    assert not mist.due(0)
    assert not alpha_of(mist).any()


def test_mist_is_never_lighter_than_the_dark_things_behind_it():
    scene = panorama.views_of(panorama.paint(), 12)
    true = panorama.slanted_mist(0.4)
    pictures = panorama.eight_bit(panorama.misted(scene, true, AIR))
    hidden = np.zeros(true.shape, bool)
    hidden[:, :30] = True
    bound = max_mist_alpha(pictures, AIR, (1, 4, 5), 0.05)[0]
    knots = np.linspace(0, 0.4, 5)
    assert (MistConfig().slack * bound > knots - 0.03).all()
    assert np.abs(bound - knots).max() < 0.2
    assert np.isnan(max_mist_alpha(pictures, AIR, (1, 4, 5), 0.05, [hidden] * 12)[0, :, 0]).all()


@pytest.mark.parametrize("most", [0.0, 0.4])
def test_places_that_all_photographs_hide_say_nothing_of_mist(most):
    scene = panorama.views_of(panorama.paint(), 12)
    pictures = panorama.eight_bit(panorama.misted(scene, panorama.slanted_mist(most), AIR))
    hidden = np.zeros(scene.shape[1:3], bool)
    hidden[: int(0.7 * len(hidden))] = True  # mist is alike in all rows
    black = [np.where(hidden[..., None], np.uint8(0), picture) for picture in pictures]
    whole, part = mist_bounds(pictures, MistConfig()), mist_bounds(black, MistConfig(), [hidden] * 12)
    assert part.mostly == whole.mostly == (most > 0)
    assert part.usual == pytest.approx(whole.usual, abs=0.03)
    assert part.colour == pytest.approx(whole.colour, abs=0.1)
    assert np.isfinite(part.possible).all()
    assert np.isfinite(part.max_alpha).all()


def test_photographs_that_hide_everything_have_no_mist():
    pictures, hidden = np.zeros((8, 30, 40, 3), np.uint8), np.ones((30, 40), bool)
    bounds = mist_bounds(list(pictures), MistConfig(), [hidden] * 8)
    assert not bounds.partly
    assert not bounds.mostly
    assert np.isfinite(bounds.possible).all()
    assert np.isfinite(bounds.colour).all()


def test_the_colour_of_mist_is_held_near_the_light_that_it_should_have():
    scene = panorama.views_of(panorama.paint(), 8)
    mist = Mist(panorama.eight_bit(scene), STEPS, MistConfig(start=0))
    mist.colour[:] = mist.expected + 0.1
    root, nothing = mist.root(0, scene[0].shape[:2]), np.zeros_like(scene[0])
    _, gradient = mist.backward(scene[0], scene[0].copy(), root, 0, nothing, nothing, BufferPool())
    assert (gradient.colour > 0).all()


def test_the_tint_of_thin_mist_is_learned():
    scene, warm = panorama.views_of(panorama.paint(), 10), AIR * np.array([1.2, 1.0, 0.7], np.float32)
    mist = learn(scene, panorama.misted(scene, panorama.slanted_mist(0.1), warm))
    assert mist.colour / mist.colour.mean() == pytest.approx(warm / warm.mean(), abs=0.01)


def test_the_steps_of_mist_fall_over_the_training():
    pictures, moved = panorama.eight_bit(panorama.views_of(panorama.paint(), 8)), []
    for iteration in (0, STEPS):
        mist = Mist(pictures, STEPS, MistConfig(start=0))
        before = mist.colour.copy()
        mist.update(MistGradient(np.zeros_like(mist.roots), np.full(3, 1e-3, np.float32)), iteration)
        moved.append(before - mist.colour)
    assert moved[1] == pytest.approx(MistConfig().final_rate * moved[0], rel=0.01)


def test_adam_counts_the_steps_that_mist_takes():
    mist = Mist(panorama.eight_bit(panorama.views_of(panorama.paint(), 8)), STEPS, MistConfig(start=0))
    late = Mist(panorama.eight_bit(panorama.views_of(panorama.paint(), 8)), STEPS, MistConfig(start=0, final_rate=1.0))
    every = Mist(panorama.eight_bit(panorama.views_of(panorama.paint(), 8)), STEPS, MistConfig(start=0, final_rate=1.0))
    gradient = MistGradient(np.zeros_like(mist.roots), np.full(3, 1e-3, np.float32))
    for step in range(10):
        every.update(gradient, step)
        late.update(gradient, 2 * step)
    assert np.array_equal(every.colour, late.colour)
    assert (every.colour < mist.colour).all()
    mist.load_state_dict({name: value.copy() for name, value in late.state_dict().items()})
    assert mist.steps == 10


def test_pictures_of_other_sizes_show_the_same_lens():
    scene = panorama.views_of(panorama.paint(), 12)
    pictures = panorama.eight_bit(panorama.misted(scene, panorama.slanted_mist(0.4), AIR))
    smaller = [cv2.resize(pictures[0], (30, 40)), *pictures[1:]]
    mixed, alike = (max_mist_alpha(group, AIR, (1, 4, 5), 0.05)[0] for group in (smaller, pictures))
    assert np.abs(mixed - alike).max() < 0.03


def test_mist_that_drifts_is_followed():
    scene = panorama.views_of(panorama.paint(), 24)
    first, last = panorama.slanted_mist(0.4), panorama.slanted_mist(0.4)[:, ::-1]
    photographs = np.concatenate(
        [panorama.misted(scene[i : i + 1], first + (last - first) * i / 23, AIR) for i in range(24)]
    )
    mist = learn(scene, photographs, MistConfig(start=0, roughness_penalty=0.005), steps=600)
    left, right = (slice(None), slice(0, 12)), (slice(None), slice(-12, None))
    assert alpha_of(mist, 0)[right].mean() > 2 * alpha_of(mist, 0)[left].mean()
    assert alpha_of(mist, 23)[left].mean() > 2 * alpha_of(mist, 23)[right].mean()


def test_a_picture_that_is_all_mist_stays_finite():
    scene = panorama.views_of(panorama.paint(), 3)
    mist = learn(scene, np.ones_like(scene), steps=60)
    assert np.isfinite(alpha_of(mist)).all()
    assert np.isfinite(mist.colour).all()
    assert alpha_of(mist).max() <= MistConfig().max_alpha + 1e-6


def test_knots_are_spread_linearly_with_the_outermost_on_the_edge():
    spread = spreading(5, 2) @ np.array([[0, 1], [2, 3]]) @ spreading(3, 2).T
    expected = 2 * (np.arange(5)[:, None] + 0.5) / 5 + (np.arange(3) + 0.5) / 3
    assert spread == pytest.approx(expected, abs=1e-6)


def test_roughness_gradient_agrees_with_differences():
    knots = np.random.default_rng(0).standard_normal((3, 4, 5))

    def roughness(values):
        return sum((np.diff(values, axis=axis) ** 2).sum() for axis in range(3)) / 2

    moved = knots.copy()
    moved[1, 2, 3] += 1e-6
    assert roughness_gradient(knots)[1, 2, 3] == pytest.approx((roughness(moved) - roughness(knots)) / 1e-6, abs=1e-4)


def test_of_many_photographs_some_of_all_times_are_looked_at():
    """Only the later half shows something dark."""
    pictures = [np.full((8, 8, 3), 255 * (i < MAX_PICTURES), np.uint8) for i in range(2 * MAX_PICTURES)]
    assert max_mist_alpha(pictures, np.ones(3, np.float32), (1, 2, 2), 0.05).max() == 0
