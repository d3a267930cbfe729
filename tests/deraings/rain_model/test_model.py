"""All kinds of rain at once: what is seen is the equation of the package, and only `update` learns."""

import numpy as np
import panorama
import pytest

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import photometric_loss, prepare_target
from baselines.training.images import TrainingImages
from deraings.image_planes import surroundings
from deraings.rain_model.drops import LensDropsConfig
from deraings.rain_model.mist_config import MistConfig
from deraings.rain_model.model import RainConfig, RainModel
from deraings.rain_model.observation import Observation
from deraings.rain_model.rain_layer import RainLayerConfig
from hydroviews.rain.streaks.effect import StreakPattern, composite, streak_layer
from hydroviews.scene.images import to_linear, to_srgb

COUNT, SIZE, STEPS, BETA = 10, (121, 160), 100, 0.88
PATTERN = StreakPattern(n=200, length=40, angle=75, width=7)
CONFIG = RainConfig(
    mist=MistConfig(start=0),
    drops=LensDropsConfig(start=0.05, min_share=0.01),
    rain_layer=RainLayerConfig(min_updates=0, start=0, rainy=0.07),
)


def rainy_views():
    """Streaks, then mist, then a drop over a known scene: photographs and scene, [N, H, W, 3] each."""
    scene, rng = panorama.views_of(panorama.paint(size=(250, 400)), COUNT, size=SIZE), np.random.default_rng(7)
    rained = [composite(view, streak_layer(PATTERN, SIZE[1], SIZE[0], rng), BETA) for view in scene]
    mist = np.tile(np.linspace(0, 0.4, SIZE[1], dtype=np.float32), (SIZE[0], 1))
    photographs = panorama.misted(np.stack(rained), mist, np.array([0.6, 0.65, 0.7]))
    photographs[:, 40:70, 30:60] = panorama.shaded_drop(30, 30)
    return photographs, scene


def step(model, photograph, scene_image, view, iteration, buffers):
    """One step of a training, as the objective does it; returns what was seen, and the gradients."""
    target = prepare_target((255 * photograph).round().astype(np.uint8))
    model.begin(iteration)
    seen = model.forward(scene_image, view, iteration, buffers)
    _, gradient = photometric_loss(seen.image, target, 0.2, seen.weights, buffers)
    observed = Observation(photograph, None, None, seen.weights)
    by_scene, by_mist = model.backward(seen, gradient, observed, buffers)
    model.update(seen, observed, by_mist, buffers)
    return seen, by_scene, by_mist


@pytest.fixture(scope="module")
def views():
    return rainy_views()


@pytest.fixture
def model(views):
    """A model that has found all kinds of rain."""
    photographs, scene = views
    model, buffers = RainModel(TrainingImages(panorama.eight_bit(photographs)), STEPS, CONFIG), BufferPool()
    for i in range(60):
        step(model, photographs[i % COUNT], scene[i % COUNT], i % COUNT, i, buffers)
    return model


def state_of(model):
    return {name: value.copy() for name, value in model.state_dict().items()}


def same(a, b):
    return a.keys() == b.keys() and all(np.array_equal(a[name], b[name]) for name in a)


def test_what_is_seen_is_the_equation(model, views):
    scene_image = views[1][3]
    seen = model.forward(scene_image, 3, 60, BufferPool())
    rain, mist, drops = (part(3, SIZE)[..., None] for part in (model.rain_alpha, model.mist_alpha, model.drop_alpha))
    assert all(alpha.max() > 0.1 for alpha in (rain, mist, drops))
    assert rain.std() > 0.02  # single streaks
    rained = (1 - rain) * scene_image + rain * BETA
    misted = to_srgb((1 - mist) * to_linear(rained) + mist * model.mist.colour)
    assert np.abs(seen.without_drops - misted).max() < 1e-4
    shown = (1 - drops) * misted + drops * surroundings(misted) + seen.drops.light
    assert np.abs(seen.image - shown).max() < 1e-4


def test_the_gradient_agrees_with_differences(model, views):
    scene_image, toward = np.clip(views[1][3], 0.05, 0.95), np.random.default_rng(0).standard_normal((*SIZE, 3))
    seen, observed = model.forward(scene_image, 3, 60, BufferPool()), Observation(views[0][3], None, None, None)
    by_scene, by_mist = model.backward(seen, toward.astype(np.float32), observed, BufferPool())
    direction = np.sign(by_scene)
    up, down = (model.forward(scene_image + s * direction, 3, 60, BufferPool()).image for s in (1e-3, -1e-3))
    expected = float(((up.astype(np.float64) - down) / 2e-3 * toward).sum())
    assert float((by_scene * direction).sum()) == pytest.approx(expected, rel=0.02)
    assert by_mist.colour.any()


def test_only_update_learns(model, views):
    photographs, scene = views
    before, buffers = state_of(model), BufferPool()
    seen, observed = model.forward(scene[3], 3, 60, buffers), Observation(photographs[3], None, None, None)
    _, by_mist = model.backward(seen, np.ones((*SIZE, 3), np.float32), observed, buffers)
    assert same(before, state_of(model))
    model.update(seen, observed, by_mist, buffers)
    after = state_of(model)
    for part in ("mist", "drops", "rain_layer"):
        assert not same(*({n: v for n, v in state.items() if n.startswith(part)} for state in (before, after)))


def test_drops_are_told_from_every_second_view(model, views):
    photographs, scene = views
    for iteration, learns in ((60, True), (61, False), (62, True)):
        sums, buffers = model.drops.lenses[0].sums, BufferPool()
        before = sums.copy()
        seen, observed = model.forward(scene[3], 3, iteration, buffers), Observation(photographs[3], None, None, None)
        _, by_mist = model.backward(seen, np.ones((*SIZE, 3), np.float32), observed, buffers)
        model.update(seen, observed, by_mist, buffers)
        assert np.array_equal(before, sums) != learns


def test_an_update_leaves_what_was_seen_as_it_was(model, views):
    """Views without their single streaks are rendered for it, in the same buffers."""
    photographs, scene = views
    buffers = BufferPool()
    seen = model.forward(scene[3], 3, 60, buffers)
    kept = seen.image.copy(), seen.without_drops.copy(), seen.rained.copy()
    observed = Observation(photographs[3], None, None, None)
    _, by_mist = model.backward(seen, np.ones((*SIZE, 3), np.float32), observed, buffers)
    model.update(seen, observed, by_mist, buffers)
    assert seen.single
    assert all(np.array_equal(a, b) for a, b in zip(kept, (seen.image, seen.without_drops, seen.rained), strict=True))


def test_it_comes_back_from_its_state(model, views):
    photographs, scene = views
    again = RainModel(TrainingImages(panorama.eight_bit(photographs)), STEPS, CONFIG)
    again.load_state_dict(state_of(model))
    for i in range(60, 75):
        one, other = (
            step(m, photographs[i % COUNT], scene[i % COUNT], i % COUNT, i, BufferPool()) for m in (model, again)
        )
        assert np.array_equal(one[1], other[1])
    assert same(state_of(model), state_of(again))


def test_drops_are_learned_from_what_is_seen_without_drops(model, views, monkeypatch):
    """Seen through the drops that are known already, photographs would follow it: they would be forgotten."""
    photographs, scene = views
    buffers, told = BufferPool(), []
    monkeypatch.setattr(model.drops, "update", lambda photograph, seen, *_: told.append(seen.copy()))
    seen = model.forward(scene[3], 3, 60, buffers)
    model.update(seen, Observation(photographs[3], None, None, None), None, buffers)
    assert np.array_equal(told[0], seen.without_drops)
    assert not np.array_equal(seen.image, seen.without_drops)
