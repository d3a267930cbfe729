"""Drops that stay on the lens, and the probability that a drop hides a pixel."""

from dataclasses import replace

import cv2
import numpy as np
import panorama
import pytest
from pretended_network import PretendedNetwork

from baselines.splatting.kernels.buffer_pool import BufferPool
from deraings.image_planes import resized, surroundings
from deraings.rain_model.config import DropsConfig, OcclusionConfig
from deraings.rain_model.drops import MIN_WINDOW, Drops
from deraings.rain_model.occlusion import LEAST_WET, MOST, Occlusion
from hydroviews.scene.images import to_uint8

DISK = (slice(18, 30), slice(25, 37))  # of the lens, in pixels
INSIDE = (slice(20, 28), slice(27, 35))  # of it, two pixels from its edge
SIZE = panorama.HEIGHT, panorama.WIDTH
SHADING = panorama.shaded_drop(12, 12)
ANYWHERE = replace(DropsConfig(), usual=-2, fixed=-1)  # lines count wherever they are


def scene_of(count, seed=0):
    return panorama.views_of(panorama.paint(seed), count)


def behind_drops(views):
    """The views with one drop that shows a shading of its own, a little lighter where the scene is."""
    wet = views.copy()
    wet[(slice(None), *DISK)] = SHADING + 0.1 * (views.mean(axis=(1, 2), keepdims=True) - 0.4)
    return wet


def looked_at(photographs, config=None, hidden=(), covers=None):
    """A lens of which only the photographs are known."""
    return Drops([to_uint8(photograph) for photograph in photographs], config or DropsConfig(), hidden, covers)


def watch(scene, photographs, config=None, epochs=3, covers=None):
    """Drops that have seen all photographs of a known scene, learned with an error of 0.02."""
    drops = looked_at(photographs, config, covers=covers)
    rng = np.random.default_rng(3)
    for view in list(range(len(scene))) * epochs:
        error = 0.02 * rng.standard_normal(scene[view].shape).astype(np.float32)
        drops.update(photographs[view], scene[view] - error, view)
    return drops


def alpha_of(drops, view=0):
    return drops.layer(view, SIZE).alpha


@pytest.mark.parametrize(
    ("known", "count", "inside", "around"), [(0, 14, 0.95, 0), (7, 24, 0.8, 3)], ids=["usual", "learned wrong"]
)
def test_a_drop_is_found_and_nothing_else(known, count, inside, around):
    """Before a scene that is learned wrong, too."""
    alpha = alpha_of(watch(scene_of(count, seed=known), behind_drops(scene_of(count))))
    assert (alpha[DISK] > 0.5).mean() > inside
    alpha[tuple(slice(part.start - around, part.stop + around) for part in DISK)] = 0
    assert (alpha > 0.5).mean() < (0.1 if known else 0.05)


@pytest.mark.parametrize("cover", [0.3, 0.7])
def test_what_a_drop_covers_and_its_own_light_are_recovered(cover):
    scene = scene_of(24)
    around = np.stack([surroundings(view) for view in scene])
    wet = scene.copy()
    light = cover * (SHADING + np.float32([-0.4, -0.3, -0.2]))
    wet[(slice(None), *DISK)] = ((1 - cover) * scene + cover * around)[(slice(None), *DISK)] + light
    layer = watch(scene, wet, ANYWHERE).layer(0, SIZE)
    assert layer.alpha[INSIDE].mean() == pytest.approx(cover, abs=0.04)
    assert np.allclose(layer.light[INSIDE], light[2:-2, 2:-2], atol=0.06)
    assert np.abs(layer.forward(scene[3], BufferPool()) - wet[3])[INSIDE].mean() < 0.02
    outside = np.ones(SIZE, bool)
    outside[16:32, 23:39] = False
    assert layer.alpha[outside].max() < 0.25
    assert np.median(layer.alpha[outside]) < 0.05
    assert (np.abs(layer.light) <= layer.alpha[..., None]).all()


@pytest.mark.parametrize("follows", [0, 0.5, 1])
def test_a_drop_is_found_however_much_its_light_follows_its_surroundings(follows):
    scene = scene_of(24)
    around = np.stack([surroundings(view) for view in scene])
    light = follows * around + (1 - follows) * around.mean(axis=(0, 1, 2))
    wet = scene.copy()
    wet[(slice(None), *DISK)] = SHADING - 0.4 + light[(slice(None), *DISK)]
    assert np.median(alpha_of(watch(scene, wet, ANYWHERE))[INSIDE]) > 0.9


def white_wall():
    scene = scene_of(14)
    scene[:, :20] = 0.95
    return scene, scene


def too_fine_to_render():
    scene = scene_of(24)
    return np.stack([cv2.GaussianBlur(view, (0, 0), 2.0) for view in scene]), scene


def learned_wrong():
    """As trees in wind are."""
    scene = scene_of(24)
    return np.concatenate([scene_of(24, seed=7)[:, :25], scene[:, 25:]], axis=1), scene


def cameras_that_stand_still():
    scene = np.repeat(scene_of(1), 14, axis=0)
    jitter = 0.02 * np.random.default_rng(4).standard_normal(scene.shape).astype(np.float32)
    return np.repeat(scene_of(1, seed=7), 14, axis=0), scene + jitter


@pytest.mark.parametrize(
    "views",
    [lambda: 2 * (scene_of(14),), white_wall, too_fine_to_render, learned_wrong, cameras_that_stand_still],
    ids=["dry", "white wall", "fine detail", "learned wrong", "still cameras"],
)
def test_without_drops_none_are_found(views):
    scene, photographs = views()
    assert (alpha_of(watch(scene, photographs)) > 0.5).mean() < 0.05


@pytest.mark.parametrize(("views", "found_alone"), [(10, True), (5, False)])
def test_a_drop_of_one_colour_is_found_by_itself_or_by_a_network(views, found_alone):
    """No detail stays in it, but it hardly changes over the views; few views do not show that."""
    scene, plain = scene_of(views), (slice(1, 10), slice(48, 60))
    wet, cover = scene.copy(), np.zeros(SIZE, np.float32)
    wet[(slice(None), *plain)], cover[plain] = 0.4, 0.8
    told, untold = (
        alpha_of(watch(scene, wet, covers=covers))[plain][3:-3, 3:-3].mean() for covers in (lambda _: cover, None)
    )
    assert told > 0.6
    assert untold > 0.6 if found_alone else untold < 0.3


def test_a_network_alone_finds_no_drop_where_photographs_follow_the_render():
    scene, cover = scene_of(14), np.ones(SIZE, np.float32)
    alpha = alpha_of(watch(scene, scene, covers=lambda _: cover))
    assert np.median(alpha) < 0.1


def test_a_drop_that_came_late_is_not_looked_for_early():
    scene = scene_of(36)
    drops = watch(scene, np.concatenate([scene[:18], behind_drops(scene[18:])]), epochs=4)
    assert (alpha_of(drops, 35)[DISK] > 0.5).mean() > 0.9
    assert (alpha_of(drops, 0)[DISK] > 0.5).mean() < 0.1


def test_a_passer_by_who_is_hidden_here_and_there_hides_no_drop():
    scene = scene_of(24)
    photographs = behind_drops(scene)
    masks = np.zeros(photographs.shape[:3], bool)
    for view, mask in enumerate(masks):
        mask[:, 5 * view % 60 : 5 * view % 60 + 20] = True  # over the drop in a third of the views
    drops = [looked_at(photographs), looked_at(np.where(masks[..., None], 0, photographs), hidden=masks)]
    for view, hidden in enumerate(masks):
        drops[0].update(photographs[view], scene[view], view)
        masked = np.where(hidden[..., None], np.float32(0), photographs[view])
        drops[1].update(masked, scene[view], view, 1 - hidden.astype(np.float32))
    expected, found = (alpha_of(each) for each in drops)
    assert expected[INSIDE].min() > 0.7
    assert np.abs(found - expected)[INSIDE].max() < 0.1


def test_what_is_hidden_in_every_view_is_no_drop():
    scene, shown = scene_of(14), np.ones(SIZE, np.float32)
    shown[DISK] = 0
    photographs = behind_drops(scene) * shown[..., None]
    drops = looked_at(photographs, ANYWHERE, [shown == 0] * len(scene))
    for view in range(len(scene)):
        drops.update(photographs[view], scene[view], view, shown)
    assert not alpha_of(drops)[DISK].any()


@pytest.mark.parametrize(("count", "least", "most"), [(20, 19, 20), (2, 0.999 * MIN_WINDOW, 1.001 * MIN_WINDOW)])
def test_views_are_counted_up_to_what_running_means_remember(count, least, most):
    scene = scene_of(count)
    drops, counts = looked_at(scene), [0.0]
    for step in range(100):
        drops.update(scene[step % count], scene[step % count], step % count)
        counts.append(drops.views_added(0))
    assert counts[1] == 1
    assert counts == sorted(counts)
    assert least < counts[-1] <= most


def test_large_views_are_looked_at_smaller_and_layers_have_any_size():
    scene = scene_of(14)
    drops = watch(scene, behind_drops(scene), DropsConfig(long_side=40))
    assert drops.size(0) == (30, 40)
    for size in (SIZE, (23, 31)):
        layer = drops.layer(0, size)
        assert (layer.alpha.shape, layer.light.shape) == (size, (*size, 3))
        rows, columns = (
            slice(s.start * n // m + 2, s.stop * n // m - 2) for s, n, m in zip(DISK, size, SIZE, strict=True)
        )
        assert layer.alpha[rows, columns].mean() > 0.8


def test_lines_are_those_of_least_squares_over_the_views():
    rng = np.random.default_rng(0)
    seen = rng.uniform(0.2, 0.8, (9, 5, 7, 3)).astype(np.float32)
    photographs = (0.4 * seen + 0.2 + 0.05 * rng.standard_normal(seen.shape)).astype(np.float32)
    drops = looked_at(photographs, replace(ANYWHERE, noise=0.0))
    for view in range(9):
        drops.update(photographs[view], seen[view], view)
    layer = drops.layer(0, (5, 7))
    weights = (1 - 1 / 9) ** np.arange(8, -1, -1)  # what running means remember
    weights = (weights / weights.sum())[:, None, None, None]
    around = np.stack([surroundings(view) for view in seen])
    shown, expected = (values.astype(np.float64) - around for values in (photographs, seen))
    means = [(weights * values).sum(axis=0) for values in (shown, expected)]
    together = (weights * (shown - means[0]) * (expected - means[1])).sum(axis=0).mean(axis=2)
    alone = (weights * (expected - means[1]) ** 2).sum(axis=0).mean(axis=2)
    alpha = np.clip(1 - together / alone, 0, 1)
    assert np.allclose(layer.alpha, alpha, atol=1e-4)
    rest = means[0] - (1 - alpha)[..., None] * means[1]
    assert np.allclose(layer.light, np.clip(rest, -alpha[..., None], alpha[..., None]), atol=1e-4)


WIDE = (90, 120)
PLACES = (slice(20, 50), slice(20, 50)), (slice(60, 90), slice(40, 70))  # of a drop: in wide, in upright pictures


@pytest.fixture(scope="module")
def two_shapes():
    """Photographs and their scene, wide and upright in turn, behind a drop."""
    scene = list(panorama.views_of(panorama.paint(size=(250, 400)), 24, size=WIDE))
    scene = [view if i % 2 == 0 else np.ascontiguousarray(np.rot90(view)) for i, view in enumerate(scene)]
    photographs = [view.copy() for view in scene]
    for i, photograph in enumerate(photographs):
        photograph[PLACES[i % 2]] = panorama.shaded_drop(30, 30)
    return scene, photographs


def test_each_shape_has_its_drops_and_they_come_back(two_shapes, caplog):
    scene, photographs = two_shapes
    with caplog.at_level("INFO"):
        drops = watch(scene, photographs, epochs=1)
    assert "2 shapes (12, 12)" in caplog.text
    again = looked_at(photographs)
    again.load_state_dict({name: value.copy() for name, value in drops.state_dict().items()})
    for view in (0, 1):
        size = scene[view].shape[:2]
        alpha = drops.layer(view, size).alpha
        assert np.array_equal(alpha, again.layer(view, size).alpha)
        assert drops.size(view) == size
        assert alpha[PLACES[view]].mean() > 0.6
        alpha[PLACES[view]] = 0
        assert alpha.mean() < 0.05


VIEWS, PLANE, SIDE = 24, (60, 80), 4
OCCLUSION = OcclusionConfig()
STAYS = (slice(12, 30), slice(20, 50))


def staying(cover=0.8):
    """Covers [h, w] of drops that stay, predicted alike in every view."""
    planes = np.zeros((VIEWS, *PLANE), np.float32)
    planes[(slice(None), *STAYS)] = cover
    return planes


def renewed(seed=0, drops=30):
    """Covers of small drops that are new in every view."""
    rng, planes = np.random.default_rng(seed), np.zeros((VIEWS, *PLANE), np.float32)
    for plane in planes:
        for row, column in rng.integers(0, PLANE, (drops, 2)):  # edges have as many: they go on at the other side
            rows, columns = (
                np.arange(start, start + SIDE) % side for start, side in zip((row, column), PLANE, strict=True)
            )
            plane[np.ix_(rows, columns)] = 0.8
    return planes


def occlusion_of(covers, config=OCCLUSION):
    return Occlusion(PretendedNetwork(covers=list(covers)), len(covers), config)


def test_all_of_the_cover_of_drops_that_stay_recurs_and_is_left_to_the_lines():
    occlusion = occlusion_of(staying())
    assert occlusion.wet
    assert occlusion.recurring == pytest.approx(1, abs=1e-5)
    assert occlusion.recurring_cover(3) == pytest.approx(occlusion.recurring * staying()[0], abs=1e-6)
    unsure = staying() * np.random.default_rng(0).uniform(0.5, 1, (VIEWS, 1, 1)).astype(np.float32)
    assert occlusion_of(unsure).recurring > 0.9


def test_none_of_the_cover_of_drops_that_are_new_in_every_view_recurs():
    assert np.mean([occlusion_of(renewed(seed)).recurring for seed in range(5)]) < 0.1
    assert not occlusion_of(renewed()).wet
    nothing = occlusion_of(np.zeros((VIEWS, *PLANE), np.float32))
    assert nothing.recurring == nothing.recurring_cover(0).max() == 0
    assert not nothing.wet


@pytest.mark.parametrize("size", [PLANE, (23, 31)])
@pytest.mark.parametrize("recurring", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("views", [0, 10, 1e9])
def test_the_prior_is_the_formula_of_the_page(size, recurring, views):
    covers = np.random.default_rng(3).random((VIEWS, *PLANE)).astype(np.float32)
    occlusion = occlusion_of(covers)
    occlusion.recurring = recurring
    q = resized(covers[2], size).astype(np.float64)
    p = (
        resized(np.delete(covers, 2, axis=0).mean(axis=0), size)
        * OCCLUSION.pseudo_views
        / (OCCLUSION.pseudo_views + views)
    )
    expected = recurring * p + (1 - recurring) * (1 - (1 - p) * (1 - q))
    assert occlusion.prior(2, size, views) == pytest.approx(expected, abs=1e-5)


def test_what_is_shown_falls_with_the_probability_of_a_drop_and_is_never_nothing():
    occlusion = occlusion_of(staying(0.4))
    pi = occlusion.prior(0, PLANE, 0).astype(np.float64)
    assert occlusion.shown(0, PLANE, 0) == pytest.approx((1 - pi) / (OCCLUSION.cost * pi + 1 - pi), abs=1e-5)
    covered = occlusion_of(staying(1.0)).shown(0, PLANE, 0)[STAYS]
    assert covered == pytest.approx((1 - MOST) / (OCCLUSION.cost * MOST + 1 - MOST), rel=1e-3)
    assert occlusion_of(staying(LEAST_WET / 2)).shown(0, PLANE, 0) is None  # a view without drops is shown in full
    assert occlusion_of(staying(2 * LEAST_WET)).shown(0, PLANE, 0) is not None
