from dataclasses import replace

import numpy as np
import panorama
import pytest

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.objective import Objective
from baselines.training.images import TrainingImages
from deraings.rain_model.drops import LensDropsConfig
from deraings.rain_model.enhanced_target import EnhancedTarget, EnhancedTargetConfig, removed_mist
from deraings.rain_model.mist import MistConfig
from deraings.rain_model.model import RainConfig
from deraings.rain_model.objective import RainObjective
from deraings.rain_model.rain_layer import RainLayerConfig
from deraings.rain_model.streaks import SingleStreaksConfig

STEPS, COUNT, CONFIG = 60, 8, EnhancedTargetConfig()
BEHIND_MIST = RainConfig(mist=MistConfig(start=0), drops=None, rain_layer=None)


class Enhanced:
    """Photographs as a network gives them, and how much mist it sees; counts how often all of them are asked for."""

    digest, tells_cover = "of a test", False

    def __init__(self, pictures, light=0.1):
        self.pictures, self.light, self.asked = TrainingImages(panorama.eight_bit(pictures)), light, 0

    def mist_light(self):
        return self.light

    def image(self, view):
        return self.pictures.pixels(view).astype(np.float32) / 255

    def training_images(self):
        self.asked += 1
        return self.pictures


@pytest.fixture(scope="module")
def scene():
    return panorama.views_of(panorama.paint(), COUNT)


def behind(scene, most):
    return panorama.misted(scene, panorama.slanted_mist(most), np.array([0.6, 0.65, 0.7], np.float32))


def objective_of(scene, enhanced, config=BEHIND_MIST):
    return RainObjective(TrainingImages(panorama.eight_bit(behind(scene, 0.4))), STEPS, config, prior=enhanced)


def test_a_network_that_takes_no_mist_away_has_removed_none_of_it(scene):
    misted = behind(scene, 0.4)
    images = TrainingImages(panorama.eight_bit(misted))
    assert removed_mist(images, Enhanced(misted), MistConfig(), 40) == 0
    part, most = (removed_mist(images, Enhanced(behind(scene, left)), MistConfig(), 40) for left in (0.2, 0.02))
    assert 0.3 < part < 0.7 < most <= 1


def test_only_a_sample_of_the_photographs_is_looked_at(scene):
    class Counted(Enhanced):
        views: list[int]

        def image(self, view):
            self.views.append(view)
            return super().image(view)

    enhanced = Counted(scene)
    enhanced.views = []
    removed_mist(TrainingImages(panorama.eight_bit(behind(scene, 0.4))), enhanced, MistConfig(), 3)
    assert enhanced.views == [0, 4, 7]


@pytest.mark.parametrize(("left", "believed"), [(0.02, True), (0.3, False), (0.4, False)])
def test_photographs_are_enhanced_only_by_a_network_that_is_believed(scene, left, believed):
    images, enhanced = TrainingImages(panorama.eight_bit(behind(scene, 0.4))), Enhanced(behind(scene, left))
    target = EnhancedTarget(images, enhanced, STEPS, MistConfig(), CONFIG)
    assert enhanced.asked == believed
    assert [step for step in range(STEPS) if target.due(step)] == (list(range(1, 36, 2)) if believed else [])


def test_in_every_second_of_the_earlier_steps_the_scene_is_compared_with_the_enhanced_photograph(scene):
    enhanced, buffers = Enhanced(scene), BufferPool()
    objective, plain = objective_of(scene, enhanced), Objective(enhanced.pictures)
    for step in range(STEPS):
        view = step % COUNT
        render = np.clip(scene[view] + np.float32(0.02), 0, 1)
        before = objective.model.mist.roots.copy()
        loss, gradient = objective(render, view, step, buffers)
        expected, g = plain(render, view, step, BufferPool())
        same = loss == expected and np.array_equal(gradient, g)
        assert same == (step % 2 == 1 and step < 0.6 * STEPS)
        assert np.array_equal(before, objective.model.mist.roots) == same
    assert objective.report()["mist_removed"] > 0.5


def test_a_step_in_which_drops_are_learned_has_the_photograph(scene):
    config = replace(BEHIND_MIST, drops=LensDropsConfig(start=0, every=1))
    enhanced = Enhanced(scene)
    loss, _ = objective_of(scene, enhanced, config)(scene[1], 1, 1, BufferPool())
    assert loss != Objective(enhanced.pictures)(scene[1], 1, 1, BufferPool())[0]


def test_what_the_photographs_hide_teaches_nothing_in_these_steps_either(scene):
    hidden = np.zeros(scene.shape[1:3], bool)
    hidden[:, :9] = True
    images = TrainingImages(panorama.eight_bit(behind(scene, 0.4)), [hidden] * COUNT)
    enhanced = Enhanced(scene)
    enhanced.pictures = TrainingImages(panorama.eight_bit(scene), [hidden] * COUNT)
    objective = RainObjective(images, STEPS, BEHIND_MIST, prior=enhanced)
    render = np.clip(scene[1] + np.float32(0.02), 0, 1)
    _, gradient = objective(render, 1, 1, BufferPool())
    assert objective.model.enhanced.due(1)
    assert not gradient[:, :9].any()
    assert gradient[:, 9:].any()


def test_on_a_clear_lens_no_photograph_is_enhanced(scene):
    enhanced = Enhanced(scene, light=0.0)
    objective = RainObjective(TrainingImages(panorama.eight_bit(scene)), STEPS, BEHIND_MIST, prior=enhanced)
    for step in range(4):
        objective(scene[step], step, step, BufferPool())
    assert objective.model.enhanced is None
    assert not enhanced.asked


def test_without_it_the_photographs_alone_are_compared_with(scene):
    enhanced = Enhanced(scene)
    objective = objective_of(scene, enhanced, replace(BEHIND_MIST, enhanced=None))
    loss, _ = objective(scene[1], 1, 1, BufferPool())
    assert not enhanced.asked
    assert loss != Objective(enhanced.pictures)(scene[1], 1, 1, BufferPool())[0]


def test_single_streaks_are_renewed_in_a_step_that_has_the_enhanced_photograph(scene):
    config = replace(BEHIND_MIST, rain_layer=RainConfig().rain_layer, streaks=SingleStreaksConfig(renewals=(0.45,)))
    objective, renewal = objective_of(scene, Enhanced(scene), config), round(0.45 * STEPS)
    objective.model.rain.streaks.visits[:] = 3
    objective(scene[0], 0, renewal, BufferPool())
    assert objective.model.enhanced.due(renewal)
    assert not objective.model.rain.streaks.visits.any()


class SeesStreaks(Enhanced):
    """A network that takes rain away, and says how much of each pixel streaks cover."""

    tells_cover, drops_stay = True, False

    def __init__(self, pictures, streaks):
        super().__init__(pictures, light=0.0)
        self.streaks = streaks

    def streak_cover(self, view):
        return np.full((panorama.HEIGHT, panorama.WIDTH), self.streaks, np.float32)

    def drop_cover(self, view):
        return np.zeros((panorama.HEIGHT, panorama.WIDTH), np.float32)


IN_RAIN = RainConfig(mist=None, rain_layer=RainLayerConfig(start=0.1, updates=9, min_updates=0))


def in_rain(scene, streaks, config=IN_RAIN):
    """An objective for photographs that are lighter than the scene, and what the network makes of them."""
    network = SeesStreaks(scene, streaks)
    photographs = TrainingImages(panorama.eight_bit(np.clip(scene + np.float32(0.1), 0, 1)))
    return RainObjective(photographs, STEPS, config, prior=network, covers=network), network


def test_where_streaks_are_seen_the_first_steps_have_enhanced_photographs(scene):
    objective, network = in_rain(scene, 0.04)
    plain, seen = Objective(network.pictures), []
    for step in range(STEPS):
        view = step % COUNT
        render = np.clip(scene[view] + np.float32(0.02), 0, 1)
        loss, gradient = objective(render, view, step, BufferPool())
        expected, g = plain(render, view, step, BufferPool())
        seen.append(loss == expected and np.array_equal(gradient, g))
    rain = objective.model.rain.layer
    assert seen == [step < 0.3 * STEPS and not rain.due(step) for step in range(STEPS)]
    assert rain.powers[0, 0] > 1  # rain was looked for all the while
    assert network.asked == 1


@pytest.mark.parametrize("config", [IN_RAIN, replace(IN_RAIN, rain_layer=None), replace(IN_RAIN, enhanced=None)])
def test_without_streaks_or_what_looks_for_rain_photographs_are_all(scene, config):
    objective, network = in_rain(scene, 0.01 if config == IN_RAIN else 0.04, config)
    assert objective.model.enhanced_target(0, scene.shape[1:3], 0) is None
    assert network.asked == 0


def test_where_detail_stays_on_the_lens_it_starts_from_the_photographs(scene):
    wet = scene.copy()
    wet[:, 12:34, 16:46] = panorama.shaded_drop(22, 30)
    objective, network = in_rain(wet, 0.04)
    assert objective.model.staying.asked
    assert objective.model.start is None
    assert network.asked == 0
