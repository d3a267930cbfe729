from dataclasses import replace
from itertools import pairwise

import numpy as np
import panorama
import pytest

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import prepare_target
from baselines.training.images import TrainingImages
from deraings.rain_model.model import RainConfig
from deraings.rain_model.objective import RainObjective
from deraings.rain_model.renewed_drops import RenewedDrops, RenewedDropsConfig
from hydroviews.scene.images import to_uint8

COUNT, STEPS = 24, 100
DROP = 12  # pixels across
MISTAKE = (slice(30, 42), slice(2, 14))  # where the network takes the scene for a drop, in every view
SHADING = panorama.shaded_drop(DROP, DROP)
CONFIG = RenewedDropsConfig()


class Prior:
    """A network that sees the drops of every view, by halves, and one that is none."""

    digest = "of a test"
    tells_cover = True

    def __init__(self, covers):
        self.covers, self.asked = covers, []

    def drop_cover(self, view):
        self.asked.append(view)
        return self.covers[view].copy()

    def mist_light(self):
        return None


@pytest.fixture(scope="module")
def scene():
    return panorama.views_of(panorama.paint(), COUNT)


@pytest.fixture(scope="module")
def places():
    """Where the drop of each view is."""
    rng = np.random.default_rng(5)
    corners = rng.integers((0, 20), (panorama.HEIGHT - DROP, panorama.WIDTH - DROP), (COUNT, 2))
    return [(slice(row, row + DROP), slice(column, column + DROP)) for row, column in corners]


@pytest.fixture(scope="module")
def photographs(scene, places):
    wet = scene.copy()
    for view, place in zip(wet, places, strict=True):
        view[place] = SHADING
    return wet


@pytest.fixture(scope="module")
def covers(places):
    seen = np.zeros((COUNT, panorama.HEIGHT, panorama.WIDTH), np.float32)
    for cover, place in zip(seen, places, strict=True):
        cover[MISTAKE] = cover[place] = 0.25
    return seen


def rendered(scene):
    """A render of the scene that is not quite right yet."""
    return np.clip(scene + 0.03 * np.random.default_rng(2).standard_normal(scene.shape), 0, 1).astype(np.float32)


def looked_at(prior, staying=0.0, config=CONFIG, hidden=()):
    images = TrainingImages(np.zeros((COUNT, panorama.HEIGHT, panorama.WIDTH, 3), np.uint8), hidden)
    return RenewedDrops(prior, images, staying, STEPS, config)


def weights_of(renewed, photograph, seen, view=0, iteration=STEPS, ignored=None):
    return (
        renewed.weights(prepare_target(to_uint8(photograph), ignored), seen, view) if renewed.due(iteration) else None
    )


def objective_of(photographs, prior, config=None):
    config = config or RainConfig(mist=None, rain_layer=None, streaks=None)
    return RainObjective(TrainingImages(panorama.eight_bit(photographs)), STEPS, config, covers=prior)


def test_a_drop_is_hidden_and_what_looks_like_the_scene_is_not(scene, places, photographs, covers):
    renewed = looked_at(Prior(covers))
    for view in range(COUNT):
        weights = weights_of(renewed, photographs[view], rendered(scene)[view], view)
        inside = weights[places[view]][2:-2, 2:-2]
        assert inside.mean() < 0.45
        assert np.median(weights[MISTAKE]) > inside.mean() + 0.2
        assert weights[covers[view] == 0].min() == 1


def test_the_weights_are_what_the_page_says(scene, photographs, covers):
    view = 3
    seen = rendered(scene)[view]
    residual = np.abs(to_uint8(photographs[view]) / 255 - seen).mean(axis=2).astype(np.float64)
    padded = np.pad(residual, 1, "reflect")
    mean = sum(padded[r : r + residual.shape[0], c : c + residual.shape[1]] for r in range(3) for c in range(3)) / 9
    agreed = np.sqrt(np.clip(mean / (2 * np.median(mean[::2, ::2])), 0.25, 2))
    cover = np.round(covers[view] * 255) / 255
    rise = np.clip((cover * agreed - 0.1) / 0.25, 0, 1)
    expected = 1 - 0.8 * rise**2 * (3 - 2 * rise)
    assert weights_of(looked_at(Prior(covers)), photographs[view], seen, view) == pytest.approx(expected, abs=1e-4)


def test_dry_photographs_are_left_alone_and_few_are_asked_for(scene):
    prior = Prior(np.full((COUNT, 45, 61), 0.02, np.float32))
    renewed = looked_at(prior)
    assert weights_of(renewed, scene[0], rendered(scene)[0]) is None
    assert not renewed.cover(0, (45, 61)).any()
    assert len(prior.asked) == CONFIG.sample
    assert prior.asked[0] == 0
    assert prior.asked[-1] == COUNT - 1
    assert all(first < second for first, second in pairwise(prior.asked))


def test_what_masks_hide_says_nothing_of_drops(scene, places, photographs, covers):
    """Hidden pixels are black: against the render they would be the largest residuals."""
    view, ignored = 3, np.zeros((panorama.HEIGHT, panorama.WIDTH), bool)
    ignored[:, : panorama.WIDTH // 2] = True
    ignored[places[view]] = False
    seen = rendered(scene)[view]
    whole, part = (
        weights_of(looked_at(Prior(covers)), photographs[view], seen, view, ignored=mask) for mask in (None, ignored)
    )
    assert np.abs(part - whole)[~ignored].max() < 0.2
    assert part[places[view]].mean() < 0.5
    nothing = weights_of(looked_at(Prior(covers)), photographs[view], seen, view, ignored=np.ones_like(ignored))
    assert np.isfinite(nothing).all()


def test_the_share_behind_drops_is_of_what_is_shown(covers):
    ignored = covers[0] == 0
    assert looked_at(Prior(covers), hidden=[ignored] * COUNT).share > 2 * looked_at(Prior(covers)).share
    assert looked_at(Prior(covers), hidden=[np.ones_like(ignored)] * COUNT).share == 0


def test_drops_that_stay_are_left_to_the_lens(covers):
    prior = Prior(covers)
    assert not looked_at(prior, staying=0.4).wanted
    assert not prior.asked


def test_nothing_is_hidden_before_views_are_learned(scene, photographs, covers):
    renewed = looked_at(Prior(covers), config=replace(CONFIG, start=0.2))
    assert weights_of(renewed, photographs[0], scene[0], 0, 19) is None
    assert weights_of(renewed, photographs[0], scene[0], 0, 20) is not None


def test_a_perfect_render_and_an_even_residual_give_finite_weights(scene, covers):
    renewed = looked_at(Prior(covers))
    for seen in (scene[0], scene[0] + np.float32(0.1)):
        weights = weights_of(renewed, scene[0], seen)
        assert np.isfinite(weights).all()
        assert weights.min() >= CONFIG.least
        assert weights.max() == 1


def test_half_sized_views_are_weighed_alike(scene, places, photographs, covers):
    renewed = looked_at(Prior(covers))
    half = [np.ascontiguousarray(image[:44:2, :60:2]) for image in (photographs[1], rendered(scene)[1])]
    weights = weights_of(renewed, *half, 1)
    assert weights.shape == (22, 30)
    rows, columns = (slice(side.start // 2 + 2, side.stop // 2 - 2) for side in places[1])
    assert weights[rows, columns].mean() < 0.5


def test_a_training_takes_drops_out_of_the_gradient_and_says_so(scene, places, photographs, covers):
    seen = rendered(scene)
    with_network, without = (objective_of(photographs, prior) for prior in (Prior(covers), None))
    buffers = BufferPool()
    for view in range(COUNT):
        pulls = [
            np.abs(o(seen[view], view, STEPS - 1, buffers)[1][places[view]]).sum() for o in (with_network, without)
        ]
        assert pulls[0] < 0.7 * pulls[1]
    found = with_network.report()
    assert "renewed" in found["needed"]
    assert found["renewed"] == pytest.approx((covers > 0.2).mean(), rel=0.2)
    assert "renewed" not in without.report()
    assert with_network.hidden(0, (45, 61))[places[0]].mean() == pytest.approx(0.25, abs=0.01)


def test_without_lines_the_lens_is_looked_at_all_the_same(scene, photographs, covers):
    alone = RainConfig(mist=None, drops=None, rain_layer=None, streaks=None)
    assert objective_of(photographs, Prior(covers), alone).model.renewed.wanted
    stays = scene.copy()
    stays[:, 15:35, 15:45] = panorama.shaded_drop(20, 30)
    assert not objective_of(stays, Prior(covers), alone).model.renewed.wanted


def test_a_network_that_does_not_tell_cover_is_not_asked(photographs, covers):
    prior = Prior(covers)
    prior.tells_cover = False
    assert objective_of(photographs, prior).model.renewed is None
    assert not prior.asked
