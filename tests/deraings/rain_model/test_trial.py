"""How often enhanced photographs are compared with, and whether layers count: by what they predict."""

import numpy as np
import panorama
import pytest
from pretended_network import PretendedNetwork
from rain_steps import resumed

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import prepare_target
from baselines.training.images import TrainingImages
from deraings.rain_model.config import RainConfig
from deraings.rain_model.drops import DropLayer
from deraings.rain_model.model import DROPS, MIST, RainModel
from deraings.rain_model.objective import LEAST_VIEWS, EnhancedTargets, RainObjective, Trial, prediction_error

COUNT, STEPS, FIRST, LAST = 24, 400, 20, 80
SIZE = panorama.HEIGHT, panorama.WIDTH
DROP = (slice(12, 34), slice(16, 46))
ON_LENS = RainConfig(rainfall=None, occlusion=None, enhanced=0)


def targets_of(change, until=0.6, iterations=10_000):
    """Enhanced photographs of two views, which change more or less than their error."""
    network = PretendedNetwork(np.zeros((2, 4, 6, 3), np.float32), change=change)
    return EnhancedTargets(network, 2, iterations, until)


def share_due(targets, first, last, view=0):
    return np.mean([targets.due(view, iteration) for iteration in range(first, last)])


def test_the_share_of_steps_with_enhanced_photographs_falls_with_time():
    targets = targets_of(lambda _: 1.0)
    shares = [share_due(targets, first, first + 1000) for first in range(0, 10_000, 1000)]
    assert shares == pytest.approx([*(1 - (np.arange(6) + 0.5) / 6), 0, 0, 0, 0], abs=0.01)


@pytest.mark.parametrize("certain", [0.0, 0.25, 0.8])
def test_the_share_of_steps_is_in_proportion_to_what_is_change_and_not_error(certain):
    targets = targets_of(lambda view: certain if view else 1.0)
    assert share_due(targets, 0, 6000, view=1) == pytest.approx(certain * share_due(targets, 0, 6000), abs=0.01)
    assert targets.share == pytest.approx((1 + certain) / 2)


@pytest.fixture(scope="module")
def scene():
    return panorama.views_of(panorama.paint(), COUNT)


@pytest.fixture(scope="module")
def wet(scene):
    photographs = panorama.misted(scene, panorama.slanted_mist(0.4), np.float32([0.6, 0.65, 0.7]))
    photographs[(slice(None), *DROP)] = panorama.shaded_drop(22, 30)
    return photographs


def render(scene, view, seed=0):
    noise = 0.02 * np.random.default_rng(1000 * seed + view).standard_normal(scene[view].shape)
    return np.clip(scene[view] + noise, 0, 1).astype(np.float32)


def model_of(photographs):
    return RainModel(TrainingImages(panorama.eight_bit(photographs)), STEPS, ON_LENS)


def tried(model, scene, photographs, last=LAST):
    """A trial of a model, over; the scene is known well all the while."""
    trial, buffers = Trial(model, COUNT, FIRST, last), BufferPool()
    targets = [prepare_target(picture) for picture in panorama.eight_bit(photographs)]
    for iteration in range(last):
        view = iteration % COUNT
        if trial.keeps(view, iteration):
            trial.look(render(scene, view, iteration), targets[view], view, iteration, buffers)
    assert not model.off  # nothing is decided before the end
    trial.keeps(0, last)
    return trial


def with_drop(alpha):
    """A layer of drops that covers as much of DROP, and shows its shading there."""
    plane, light = np.zeros(SIZE, np.float32), np.zeros((*SIZE, 3), np.float32)
    plane[DROP] = alpha
    light[DROP] = alpha * (panorama.shaded_drop(22, 30) - np.float32(0.35))
    return DropLayer(plane, light)


def test_one_view_in_twelve_is_kept_until_the_trial_is_over_and_none_of_few(scene):
    model, few = model_of(scene), LEAST_VIEWS - 1
    trial = Trial(model, few, FIRST, LAST)
    assert not any(trial.keeps(view, iteration) for view in range(few) for iteration in range(LAST + 2))
    assert not model.off
    assert trial.report() == {}
    trial = Trial(model, COUNT, FIRST, LAST)
    for iteration, kept in ((0, [6, 18]), (LAST - 1, [6, 18]), (LAST, []), (LAST - 1, [])):
        assert [view for view in range(COUNT) if trial.keeps(view, iteration)] == kept


def test_a_helpful_layer_stays(scene, wet):
    model = model_of(wet)
    model.drops.layer = lambda *_: with_drop(1.0)
    trial = tried(model, scene, wet, 5 * LAST)
    assert model.off == set()
    for layer in (DROPS, MIST):
        assert np.mean(trial.gains[layer]) > 0
        assert trial.report()[f"{layer}_gain"] > 0


@pytest.mark.parametrize("harmful", [DROPS, MIST])
def test_a_harmful_layer_is_switched_off(scene, harmful):
    """It shows, in front of a dry scene, what is not there."""
    model = model_of(scene)
    if harmful == DROPS:
        model.drops.layer = lambda *_: with_drop(0.5)
        model.mist.roots[:] = 0
    else:
        model.mist.roots[:] = np.linspace(0, 0.7, model.mist.roots[0].size).reshape(model.mist.roots[0].shape)
    trial = tried(model, scene, scene)
    assert harmful in model.off
    assert trial.report()[f"{harmful}_gain"] < -2
    assert harmful not in model.needed()


def test_drops_have_to_help_and_mist_has_not_to_harm(scene):
    """A dry lens: neither predicts anything."""
    model = model_of(scene)
    model.off.clear()
    model.mist.roots[:], model.drops.layer = 0, lambda *_: with_drop(0.0)
    tried(model, scene, scene)
    assert model.off == {DROPS}
    assert model.needed() == [MIST]


def test_gains_are_counted_in_the_second_half_of_the_trial_alone(scene, wet):
    model, buffers = model_of(wet), BufferPool()
    trial, target = Trial(model, COUNT, FIRST, LAST), prepare_target(panorama.eight_bit(wet)[6])
    trial.look(render(scene, 6), target, 6, 50, buffers)
    assert trial.gains == {MIST: [], DROPS: []}
    trial.look(render(scene, 6), target, 6, 51, buffers)
    assert [len(gains) for gains in trial.gains.values()] == [1, 1]


def test_kept_views_teach_nothing(scene, wet):
    objective = RainObjective(TrainingImages(panorama.eight_bit(wet)), STEPS, ON_LENS)
    before = {name: value.copy() for name, value in objective.state_dict().items()}
    loss, gradient = objective(render(scene, 6), 6, 10, BufferPool())
    assert loss > 0
    assert not gradient.any()
    assert gradient.shape == (*SIZE, 3)
    for name, value in objective.state_dict().items():
        assert np.array_equal(value, before[name]), name
    assert objective(render(scene, 5), 5, 10, BufferPool())[1].any()
    assert objective(render(scene, 6), 6, LAST, BufferPool())[1].any()


def test_a_trial_survives_a_checkpoint(scene, wet):
    images = TrainingImages(panorama.eight_bit(wet))
    whole, first, second, third = (RainObjective(images, STEPS, ON_LENS) for _ in range(4))
    resumed(whole, first, second, [render(scene, view) for view in range(COUNT)], 70, 100)
    assert len(first.trial.gains[MIST]) > 1
    assert second.trial.gains == whole.trial.gains
    whole.model.off = {DROPS}
    third.load_state_dict(whole.state_dict())
    assert third.model.off == {DROPS}
    assert not any(third.trial.keeps(view, 0) for view in range(COUNT))


def test_predictions_are_compared_after_gain_and_offset_of_each_channel_where_nothing_is_hidden(scene):
    target = prepare_target(panorama.eight_bit(scene)[0])
    darker = target.image * np.float32([0.5, 0.6, 0.7]) + np.float32([0.2, 0.1, 0])
    assert prediction_error(darker, target) == pytest.approx(0, abs=1e-4)
    assert prediction_error(render(scene, 0), target) == pytest.approx(0.016, abs=0.006)
    flat = np.full_like(target.image, 0.5)
    expected = np.abs(target.image - target.image.mean(axis=(0, 1))).mean()
    assert prediction_error(flat, target) == pytest.approx(expected, rel=1e-3)
    hidden = np.zeros(SIZE, bool)
    hidden[:, :30] = True
    wrong = np.where(hidden[..., None], np.float32(1), target.image)
    assert prediction_error(wrong, prepare_target(target.pixels, hidden)) == pytest.approx(0, abs=1e-4)
