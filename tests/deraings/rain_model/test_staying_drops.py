"""A network's word on drops that stay: before lines are known, and where few photographs would never tell them."""

from dataclasses import replace

import numpy as np
import panorama
import pytest

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.training.images import TrainingImages
from deraings.rain_model.model import RainConfig
from deraings.rain_model.objective import RainObjective
from deraings.rain_model.still_pixels import MIN_VIEWS

STEPS, MANY, FEW = 100, 30, 10
DROP = (slice(12, 34), slice(16, 46))
SIZE = (panorama.HEIGHT, panorama.WIDTH)
SHADING = panorama.shaded_drop(22, 30)
ALONE = RainConfig(mist=None, rain_layer=None, streaks=None)


class Prior:
    """A network that sees the same drops on the lens in every view."""

    digest = "of a test"
    tells_cover = True

    def __init__(self, stay=True):
        self.stay, self.asked = stay, False

    @property
    def drops_stay(self):
        self.asked = True
        return self.stay

    def hidden_by_drops(self, view):
        hidden = np.zeros(SIZE, np.float32)
        hidden[DROP] = 0.8
        return hidden

    def drop_cover(self, view):
        return np.zeros(SIZE, np.float32)

    def mist_light(self):
        return None


@pytest.fixture(scope="module")
def scene():
    return panorama.views_of(panorama.paint(), MANY)


def wet(scene):
    photographs = scene.copy()
    photographs[(slice(None), *DROP)] = SHADING
    return photographs


def objective_of(photographs, prior, config=ALONE):
    return RainObjective(TrainingImages(panorama.eight_bit(photographs)), STEPS, config, covers=prior)


def pull(objective, render, iteration):
    """How much a step pulls at the scene behind the drop, and next to it."""
    gradient = np.abs(objective(render, 0, iteration, BufferPool())[1])
    return gradient[DROP].mean(), gradient[:, :8].mean()


def test_from_the_first_step_the_scene_learns_little_of_what_the_network_sees_of_drops(scene):
    told, untold = (objective_of(wet(scene), prior) for prior in (Prior(), None))
    inside, beside = zip(pull(told, scene[0], 0), pull(untold, scene[0], 0), strict=True)
    assert inside[0] < 0.4 * inside[1]
    assert beside[0] == pytest.approx(beside[1], rel=0.3)


@pytest.mark.parametrize(("count", "to_the_end"), [(MANY, False), (FEW, True)])
def test_of_many_photographs_lines_tell_in_the_end_of_few_the_network(scene, count, to_the_end):
    model = objective_of(wet(scene)[:count], Prior()).model
    due = [model.staying.due(iteration) for iteration in (0, STEPS // 2 - 1, STEPS // 2, STEPS - 1)]
    assert due == [True, True, to_the_end, to_the_end]
    cover = model.seen_cover(0, SIZE)
    assert cover[DROP].mean() == pytest.approx(0.8 if to_the_end else 0, abs=0.05)


@pytest.mark.parametrize(("views", "found_alone"), [(FEW, True), (MIN_VIEWS - 1, False)])
def test_a_drop_of_one_colour_is_found_by_itself_or_by_a_network(scene, views, found_alone):
    """No detail stays in it, but it hardly changes over the views; few views do not show that."""
    plain = (slice(1, 10), slice(48, 60))
    photographs = wet(scene)[:views]
    photographs[(slice(None), *plain)] = 0.4

    class Sees(Prior):
        def hidden_by_drops(self, view):
            hidden = super().hidden_by_drops(view)
            hidden[plain] = 0.8
            return hidden

    found = []
    for prior in (Sees(), None):
        drops = objective_of(photographs, prior).model.drops
        for view in list(range(views)) * 3:
            drops.update(photographs[view], scene[view], view)
        found.append(drops.lenses[0].line(0)[0][plain][3:-3, 3:-3].mean())
    assert found[0] > 0.6
    assert (found[1] > 0.6) == found_alone
    assert found_alone or found[1] < 0.3


def test_the_network_is_not_asked_where_no_detail_stays(scene):
    prior = Prior()
    model = objective_of(scene, prior).model
    assert not prior.asked
    assert not model.staying.wanted
    assert model.renewed is not None


def test_where_the_network_sees_none_all_is_as_without_it(scene):
    prior = Prior(stay=False)
    told, untold = (objective_of(wet(scene), one) for one in (prior, None))
    assert prior.asked
    for iteration in range(0, STEPS, 10):
        loss, gradient = told(scene[3], 3, iteration, BufferPool())
        expected = untold(scene[3], 3, iteration, BufferPool())
        assert loss == expected[0]
        assert np.array_equal(gradient, expected[1])


def test_renewed_drops_are_not_looked_for_where_drops_stay(scene):
    assert objective_of(wet(scene), Prior()).model.renewed is None
    masked = replace(ALONE, staying=None)
    assert objective_of(wet(scene), Prior(), masked).model.staying is None
    assert objective_of(wet(scene), Prior(), replace(ALONE, drops=None)).model.staying is None


def test_what_was_seen_is_reported_and_hidden(scene):
    objective = objective_of(wet(scene)[:FEW], Prior())
    report = objective.report()
    assert report["drops_seen"] == pytest.approx(22 * 30 / (SIZE[0] * SIZE[1]), abs=0.01)
    assert objective.hidden(0, SIZE)[DROP].min() > 0.7
    assert "drops_seen" not in objective_of(scene, Prior()).report()


def test_upright_photographs_are_believed_where_their_own_drops_are(scene):
    """Each shape has a lens of its own, in the places of its own views."""
    turned = [np.ascontiguousarray(np.rot90(view)) if i % 2 else view for i, view in enumerate(wet(scene))]

    class Turned(Prior):
        def hidden_by_drops(self, view):
            hidden = super().hidden_by_drops(view)
            return np.ascontiguousarray(np.rot90(hidden)) if view % 2 else hidden

    untold, told = (objective_of(turned, prior).model.drops for prior in (None, Turned()))
    for lens, before in zip(told.lenses, untold.lenses, strict=True):
        assert (lens._believed >= before._believed - 1e-6).all()
    wide, upright = told.lenses
    assert wide._believed[0][DROP].min() > 0.75
    assert upright._believed[0][np.rot90(Prior().hidden_by_drops(0)) > 0].min() > 0.75
