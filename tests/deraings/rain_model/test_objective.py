import json
from dataclasses import replace

import numpy as np
import panorama
import pytest
from pretended_network import PretendedNetwork
from rain_steps import assert_same_steps, let_it_rain, resumed, steps

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.objective import Objective
from baselines.training.images import TrainingImages
from deraings.lens.mist_prior import NetworkMist
from deraings.masks.config import MaskConfig
from deraings.masks.occlusion_masks import OcclusionMasks
from deraings.rain_model.config import DropsConfig, RainConfig
from deraings.rain_model.drops import DropLayer
from deraings.rain_model.objective import RainObjective

STEPS = 60
SIZE = panorama.HEIGHT, panorama.WIDTH
EAGER = RainConfig(start=0.1)
NOTHING = RainConfig(mist=None, drops=None, occlusion=None, rainfall=None, enhanced=0)


def scene_of(count):
    return panorama.views_of(panorama.paint(), count)


def renders(scene, seed=0):
    """What a render of the scene may look like: right up to noise."""
    noise = 0.03 * np.random.default_rng(seed).standard_normal(scene.shape)
    return np.clip(scene + noise, 0, None).astype(np.float32)


def objective_of(scene, config=EAGER, **more):
    return RainObjective(TrainingImages(panorama.eight_bit(scene)), STEPS, config, **more)


def test_without_any_rain_to_look_for_it_is_the_plain_loss():
    scene = scene_of(4)
    plain, ours = Objective(TrainingImages(panorama.eight_bit(scene))), objective_of(scene, NOTHING)
    assert_same_steps(steps(ours, renders(scene), 0, 4), steps(plain, renders(scene), 0, 4))


def rainy(objective, even=0.1, mist=0.3):
    """The objective with rain in it, as if it had been found."""
    objective.model.mist.roots[:] = np.sqrt(mist)
    return let_it_rain(objective, even)


def test_gradient_agrees_with_differences():
    scene = scene_of(3)
    image = np.clip(renders(scene)[0], 0.05, 1)
    objective = rainy(objective_of(scene, replace(EAGER, drops=None, start=0.5)))
    _, gradient = objective(image, 0, 1, BufferPool())
    rainy(objective)  # as before the step
    objective.model.mist.colour[:] = objective.model.mist.expected
    rng = np.random.default_rng(4)
    for direction in (np.sign(gradient), np.sign(gradient) * (rng.uniform(size=gradient.shape) < 0.2)):
        up, down = (
            objective.residual(image + s * direction.astype(np.float32), 0, BufferPool()) for s in (5e-4, -5e-4)
        )
        assert (up - down) / 1e-3 == pytest.approx(float((gradient * direction).sum()), rel=0.02)


@pytest.mark.parametrize("even", [0.0, 0.1])
def test_behind_falling_rain_mist_learns_from_differences_alone(even):
    """SSIM asks for the contrast that streaks give photographs: it would take mist away."""
    scene = scene_of(8)
    photographs = panorama.misted(scene, panorama.slanted_mist(0.3), np.float32([0.6, 0.6, 0.6]))
    config = replace(RainConfig(), drops=None, start=0.9)
    one, other = (objective_of(photographs, config, lambda_dssim=share) for share in (0.0, 0.9))
    for objective in (one, other):
        let_it_rain(objective, even)
        steps(objective, renders(scene), 0, 24)
    mists = one.model.mist, other.model.mist
    assert mists[0].roots.max() > 0.1
    assert np.array_equal(*(mist.roots for mist in mists)) == (even > 0)
    assert np.array_equal(*(mist.colour for mist in mists)) == (even > 0)


def test_training_taken_up_again_goes_on_the_same():
    """All of it: mist's steps of Adam, which are not those of the training, as well."""
    scene = scene_of(14)
    resumed(*(objective_of(scene) for _ in range(3)), renders(scene), 30, STEPS)


def test_pixels_that_are_not_finite_teach_nothing():
    scene = scene_of(8)
    objective, images = objective_of(scene), renders(scene)
    images[:, 3:5, 4:6] = np.nan
    for loss, gradient in steps(objective, images, 0, STEPS):
        assert np.isfinite(loss)
        assert np.isfinite(gradient).all()
    assert all(np.isfinite(value).all() for value in objective.state_dict().values())


def test_hidden_pixels_of_the_photographs_teach_nothing():
    scene, hidden = scene_of(8), np.zeros(SIZE, bool)
    hidden[:10] = True

    def trained(images):
        photographs = TrainingImages(panorama.eight_bit(scene), [hidden] * len(scene))
        objective = RainObjective(photographs, STEPS, replace(EAGER, drops=None))  # drops show light from all around
        return steps(objective, images, 0, STEPS)

    changed = renders(scene)
    changed[:, :10] = 0.9
    found = trained(changed)
    assert_same_steps(found, trained(renders(scene)))
    assert not any(gradient[:10].any() for _, gradient in found)


def test_masks_learn_from_the_loss_and_weigh_it():
    scene = scene_of(8)
    learned = []

    class Left(OcclusionMasks):
        """Masks the left of every view."""

        def learn(self, view, loss, iteration):
            learned.append((view, iteration, loss.shape))

        def weights(self, view, size, iteration):
            plane = np.ones(size, np.float32)
            plane[:, :30] = 0
            return plane

    masks = Left(TrainingImages(panorama.eight_bit(scene)), 10, 0, MaskConfig(start=0.2, every=2))
    objective = objective_of(scene, NOTHING, pixel_weights=masks)
    (_, gradient), *_ = steps(objective, renders(scene), 0, 3)
    assert learned == [(0, 0, SIZE), (2, 2, SIZE)]
    assert not gradient[:, :24].any()
    assert gradient[:, 36:].any()


def test_what_is_wholly_behind_a_drop_teaches_the_scene_nothing():
    """Neither by what is left of the pixel nor by the windows of SSIM around it."""
    scene = scene_of(8)
    objective = objective_of(scene, replace(NOTHING, drops=DropsConfig(), start=0))
    alpha = np.zeros(SIZE, np.float32)
    alpha[:, :30] = 1
    objective.model.drops.layer = lambda *_: DropLayer(alpha, np.zeros_like(scene[0]))
    (_, gradient), *_ = steps(objective, renders(scene), 0, 1)
    assert not gradient[:, :24].any()
    assert gradient[:, 36:].any()


def test_what_is_hidden_is_what_rain_covers():
    objective = objective_of(scene_of(8), NOTHING)
    assert not objective.hidden(0, SIZE).any()
    objective.model.drop_alpha = lambda view, size: np.eye(*size, dtype=np.float32)
    hidden = objective.hidden(0, SIZE)
    assert (hidden.dtype, hidden.shape) == (np.float32, SIZE)
    assert np.array_equal(hidden, np.eye(*SIZE))


def test_what_was_found_and_the_settings_can_be_written_down():
    objective = objective_of(scene_of(3))
    written = json.loads(json.dumps(objective.settings()))
    assert written["rain"]["drops"]["noise"] == EAGER.drops.noise
    other = objective_of(scene_of(3), replace(EAGER, drops=DropsConfig(noise=0.2)))
    assert json.loads(json.dumps(other.settings())) != written
    assert json.loads(json.dumps(let_it_rain(objective, 0.1).report()))["rain"] == 0.1


def test_what_is_hidden_and_what_is_broken_teaches_nothing_of_the_lens():
    scene, hidden = scene_of(8), np.zeros(SIZE, bool)
    hidden[:10] = True
    objective = RainObjective(TrainingImages(panorama.eight_bit(scene), [hidden] * 8), STEPS, NOTHING)
    told, image = [], renders(scene)[0]
    image[20, 20] = np.nan
    objective.model.update = lambda seen, observed, *_: told.append(observed)
    objective(image, 0, 1, BufferPool())
    hidden[20, 20] = True
    assert np.array_equal(told[0].shown == 0, hidden)


def test_a_step_with_the_enhanced_photograph_compares_it_with_the_scene_as_it_is():
    """The network takes all mist away."""
    scene = scene_of(8)
    photographs = panorama.misted(scene, panorama.slanted_mist(0.4), np.float32([0.6, 0.65, 0.7]))
    light = np.full((16, 16), 0.6, np.float32)
    network = PretendedNetwork(scene, mist=NetworkMist(light, light), change=lambda _: 1.0)
    config = replace(NOTHING, mist=RainConfig().mist, drops=DropsConfig(every=1), enhanced=0.6)
    objective, plain = objective_of(photographs, config, network=network), Objective(network.training_images())
    seen = []
    for step in range(STEPS):
        view, roots = step % 8, objective.model.mist.roots.copy()
        sums = objective.model.drops.lenses[0].sums.copy()
        render = np.clip(scene[view] + np.float32(0.02), 0, 1)
        objective.model.off = {"drops"} if step < 30 else set()
        loss, gradient = objective(render, view, step, BufferPool())
        expected, g = plain(render, view, step, BufferPool())
        enhanced = objective.enhanced.due(view, step)
        seen.append(enhanced)
        if step < 30:
            assert (loss == expected and np.array_equal(gradient, g)) == enhanced
        else:
            assert not np.array_equal(sums, objective.model.drops.lenses[0].sums)
        assert np.array_equal(roots, objective.model.mist.roots) == enhanced
    assert 0.3 < np.mean(seen[:36]) < 0.7
    assert not any(seen[36:])
    assert objective.report()["enhanced"] == 1


def test_mist_that_the_network_leaves_in_enhanced_photographs_is_seen_there():
    """The network predicts no mist, and its pictures are as misty as the photographs."""
    scene = scene_of(8)
    mist = panorama.slanted_mist(0.4)
    photographs = panorama.misted(scene, mist, np.float32([0.6, 0.65, 0.7]))
    config = replace(NOTHING, mist=RainConfig().mist, enhanced=0.6)
    objective = objective_of(photographs, config, network=PretendedNetwork(photographs, change=lambda _: 1.0))
    objective.model.mist.roots[:] = np.sqrt(0.3)
    step = next(step for step in range(STEPS) if objective.enhanced.due(0, step))
    misty, by_misty = objective(scene[0], 0, step, BufferPool())
    objective.model.off = {"mist"}
    clear, by_clear = objective(scene[0], 0, step, BufferPool())
    assert misty < 0.8 * clear
    assert np.abs(by_misty).mean() < np.abs(by_clear).mean()


def test_enhanced_photographs_are_targets_at_any_size_where_they_hide_nothing():
    scene, hidden = scene_of(2), np.zeros(SIZE, bool)
    hidden[:, :9] = True
    network = PretendedNetwork(scene, change=lambda _: 1.0, hidden=[hidden] * 2)
    images = TrainingImages(panorama.eight_bit(scene), [hidden] * 2)
    objective = RainObjective(images, STEPS, replace(NOTHING, enhanced=0.6), network=network)
    enhanced = objective.enhanced
    assert np.array_equal(enhanced.target(1, SIZE).pixels, network.training_images().pixels(1))
    assert enhanced.target(1, (22, 30)).pixels.shape == (22, 30, 3)
    _, gradient = objective(renders(scene)[0], 0, 0, BufferPool())
    assert enhanced.due(0, 0)
    assert not gradient[:, :9].any()
    assert gradient[:, 9:].any()


def test_without_its_steps_the_network_is_not_asked_for_pictures():
    network = PretendedNetwork(scene_of(2), change=lambda _: 1.0)
    objective = objective_of(scene_of(2), NOTHING, network=network)
    assert network.read == 0
    assert not any(objective.enhanced.due(0, step) for step in range(STEPS))
    assert objective.report()["enhanced"] == 0
