"""All kinds of rain at once: what is seen is the equation of the package, and only `update` learns."""

import numpy as np
import panorama
import pytest
from pretended_network import PretendedNetwork

from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import photometric_loss, prepare_target
from baselines.training.images import TrainingImages
from deraings.image_planes import surroundings
from deraings.lens.mist_prior import NetworkMist
from deraings.rain_model.config import RainConfig
from deraings.rain_model.model import DROPS, MIST, Observation, RainModel
from hydroviews.rain.streaks.recipe import StreakPattern, composite, streak_layer
from hydroviews.scene.images import to_linear, to_srgb

COUNT, SIZE, STEPS, BETA = 10, (121, 160), 100, 0.88
PATTERN = StreakPattern(n=200, length=40, angle=75, width=7)
CONFIG = RainConfig()
DROP = (slice(40, 70), slice(30, 60))
MIST_ALPHA = np.tile(np.linspace(0, 0.4, SIZE[1], dtype=np.float32), (SIZE[0], 1))


def rainy_views():
    """Streaks, then mist, then a drop over a known scene, and the network's pictures: without streaks.

    Photographs, scene and pictures, [N, H, W, 3] each.
    """
    scene, rng = panorama.views_of(panorama.paint(size=(250, 400)), COUNT, size=SIZE), np.random.default_rng(7)
    rained = [composite(view, streak_layer(PATTERN, SIZE[1], SIZE[0], rng), BETA) for view in scene]
    photographs, dry = (panorama.misted(np.stack(p), MIST_ALPHA, np.array([0.6, 0.65, 0.7])) for p in (rained, scene))
    for pictures in (photographs, dry):
        pictures[(slice(None), *DROP)] = panorama.shaded_drop(30, 30)
    return photographs, scene, dry


def step(model, photograph, scene_image, view, iteration, buffers):
    """One step of a training, as the objective does it; returns what was seen, and the gradients."""
    target = prepare_target((255 * photograph).round().astype(np.uint8))
    seen = model.forward(scene_image, view, iteration, buffers)
    weights = model.weights(view, SIZE, iteration)
    _, gradient = photometric_loss(seen.image, target, 0.2, weights, buffers)
    observed = Observation(photograph, None, weights)
    by_scene, by_mist = model.backward(seen, gradient, observed, buffers)
    model.update(seen, observed, by_mist)
    return seen, by_scene, by_mist


@pytest.fixture(scope="module")
def views():
    return rainy_views()


def model_of(photographs, *network, **covers):
    return RainModel(TrainingImages(panorama.eight_bit(photographs)), STEPS, CONFIG, *network, **covers)


def wet_model(views):
    """A model that a network supports in falling rain alone."""
    covers = np.zeros((COUNT, *SIZE), np.float32)
    covers[(slice(None), *DROP)] = 1
    return model_of(views[0], PretendedNetwork(views[2], covers, photographs=views[0]))


@pytest.fixture
def model(views, found):
    """A model that has found all kinds of rain."""
    model = wet_model(views)
    model.load_state_dict({name: value.copy() for name, value in found.items()})
    return model


@pytest.fixture(scope="module")
def found(views):
    """The state of such a model."""
    photographs, scene, _ = views
    model, buffers = wet_model(views), BufferPool()
    for i in range(60):
        step(model, photographs[i % COUNT], scene[i % COUNT], i % COUNT, i, buffers)
    return state_of(model)


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
    seen, observed = model.forward(scene_image, 3, 60, BufferPool()), Observation(views[0][3], None, None)
    by_scene, by_mist = model.backward(seen, toward.astype(np.float32), observed, BufferPool())
    direction = np.sign(by_scene)
    up, down = (model.forward(scene_image + s * direction, 3, 60, BufferPool()).image for s in (1e-3, -1e-3))
    expected = float(((up.astype(np.float64) - down) / 2e-3 * toward).sum())
    assert float((by_scene * direction).sum()) == pytest.approx(expected, rel=0.02)
    assert by_mist.colour.any()


def test_only_update_learns_and_leaves_what_was_seen_as_it_was(model, views):
    photographs, scene, _ = views
    before, buffers = state_of(model), BufferPool()
    seen, observed = model.forward(scene[3], 3, 60, buffers), Observation(photographs[3], None, None)
    kept = [part.copy() for part in (seen.image, seen.without_drops, seen.rained)]
    _, by_mist = model.backward(seen, np.ones((*SIZE, 3), np.float32), observed, buffers)
    assert same(before, state_of(model))
    model.update(seen, observed, by_mist)
    after = state_of(model)
    for part in ("mist", "drops"):
        assert not same(*({n: v for n, v in state.items() if n.startswith(part)} for state in (before, after)))
    assert all(np.array_equal(a, b) for a, b in zip(kept, (seen.image, seen.without_drops, seen.rained), strict=True))


def test_drops_are_learned_from_what_is_seen_without_drops(model, views, monkeypatch):
    """Seen through the drops that are known already, photographs would follow it: they would be forgotten."""
    photographs, scene, _ = views
    buffers, told = BufferPool(), []
    monkeypatch.setattr(model.drops, "update", lambda photograph, seen, *_: told.append(seen.copy()))
    seen = model.forward(scene[3], 3, 60, buffers)
    model.update(seen, Observation(photographs[3], None, None), None)
    assert np.array_equal(told[0], seen.without_drops)
    assert not np.array_equal(seen.image, seen.without_drops)


def test_all_layers_are_found_where_they_were_drawn(model, views):
    inside, mist, drop = np.zeros(SIZE, bool), model.mist_alpha(3, SIZE), model.drop_alpha(3, SIZE)
    inside[DROP] = True
    assert (drop[inside] > 0.5).mean() > 0.8
    assert (drop[~inside] > 0.5).mean() < 0.1
    assert np.corrcoef(mist[~inside], MIST_ALPHA[~inside])[0, 1] > 0.9
    assert model.needed() == ["mist", "drops", "rain"]
    report = model.report(dict.fromkeys((0, 3), SIZE))
    assert report["mist_mean"] == pytest.approx(max(model.mist_alpha(view, SIZE).mean() for view in (0, 3)))
    assert report["drops"] == pytest.approx(inside.mean(), abs=0.03)
    assert report["rain"] > 0.02
    assert report["streaks"] > 0.02
    assert all(isinstance(value, float) for value in report.values())


@pytest.mark.parametrize("layer", [MIST, DROPS])
def test_a_layer_that_is_left_out_or_off_is_not_seen_through(model, views, layer):
    scene_image, buffers = views[1][3], BufferPool()
    without = model.forward(scene_image, 3, 60, buffers, without=layer)
    kept = without.image.copy(), without.mist_root, without.drops
    model.off = {layer}
    off = model.forward(scene_image, 3, 60, BufferPool())
    assert np.array_equal(off.image, kept[0])
    assert (off.mist_root is None) == (layer == MIST)
    assert (off.drops is None) == (layer == DROPS)
    alpha = model.mist_alpha(3, SIZE) if layer == MIST else model.drop_alpha(3, SIZE)
    assert not alpha.any()
    assert layer not in model.needed()
    if layer == DROPS:
        assert model.weights(3, SIZE, 60) is None


def test_drops_do_not_count_before_their_start(model, views):
    assert model.forward(views[1][3], 3, 4, BufferPool()).drops is None
    assert model.forward(views[1][3], 3, 5, BufferPool()).drops is not None


def test_what_a_network_predicts_is_evidence_of_each_layer(views):
    photographs, *_ = views
    covers = np.zeros((COUNT, *SIZE), np.float32)
    covers[(slice(None), *DROP)] = 0.8
    light = np.full((16, 16), 0.02, np.float32)
    network = PretendedNetwork(photographs, covers, NetworkMist(light, light / 10), photographs=photographs)
    alone, model = model_of(photographs), model_of(photographs, network, covers=network)
    assert model.mist.prior.deviation.mean() < alone.mist.prior.deviation.mean()
    assert model.occluded(3, SIZE)[DROP].mean() == pytest.approx(0.8, abs=0.01)
    assert not alone.occluded(3, SIZE).any()
    report = model.report({3: SIZE})
    assert report["recurring"] == pytest.approx(1, abs=1e-3)
    assert report["occluded"] == pytest.approx(covers[3].mean(), rel=0.02)
    weights = model.weights(3, SIZE, 0)
    assert weights[DROP].mean() < 0.3
    assert weights[:30].min() == 1
    assert model.settings()["network"] == "of a test"
    untold = model_of(photographs, covers=PretendedNetwork())  # which predicts no cover
    assert untold.occlusion is None
    assert "occluded" not in untold.report({0: SIZE})
