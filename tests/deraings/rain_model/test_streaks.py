import cv2
import numpy as np
import panorama
import pytest
from pretended_network import PretendedNetwork
from rain_steps import resumed, steps
from scipy import fft

from baselines.training.images import TrainingImages
from deraings.image_planes import resized
from deraings.rain_model.config import RainConfig, RainfallConfig
from deraings.rain_model.objective import RainObjective
from deraings.rain_model.rainfall import Observation, Rainfall
from deraings.rain_model.streaks import SingleStreaks, along_rain, wiener_gain
from hydroviews.rain.streaks.recipe import StreakPattern, composite, streak_layer
from hydroviews.scene.images import to_uint8

COUNT, SIZE, BETA = 10, (121, 160), 0.88
VISITS = 3
PATTERN = StreakPattern(n=200, length=40, angle=75, width=7)


@pytest.fixture(scope="module")
def scene():
    return panorama.views_of(panorama.paint(size=(250, 400)), COUNT, size=SIZE)


def layers(angle=75.0):
    """Streaks [N, H, W], new in every view."""
    rng = np.random.default_rng(7)
    pattern = StreakPattern(PATTERN.n, PATTERN.length, angle, PATTERN.width)
    return np.stack([streak_layer(pattern, SIZE[1], SIZE[0], rng) for _ in range(COUNT)])


def rained_on(scene, covers):
    return np.stack([composite(*pair, BETA) for pair in zip(scene, covers, strict=True)])


def learned(scene, seed=3):
    """The scene as it is learned early on: without some of its fine detail, and with noise."""
    rng = np.random.default_rng(seed)
    blurred = [cv2.GaussianBlur(view, (3, 3), 0) for view in scene]
    return (np.stack(blurred) + 0.02 * rng.standard_normal(scene.shape)).astype(np.float32)


def watch(photographs, known, even, angle=75.0, rounds=3, priors=(None,) * COUNT):
    """Streaks after some looks at every view."""
    streaks = SingleStreaks((SIZE,) * COUNT, VISITS)
    for _ in range(rounds):
        for view, (photograph, expected) in enumerate(zip(photographs, known, strict=True)):
            seen = (expected * (1 - even) + even * BETA).astype(np.float32)
            streaks.update(*along_rain(photograph, seen, even, BETA), angle, view, priors[view])
    return streaks


def alpha_of(streaks, view, even):
    return np.maximum(even + resized(streaks.deviation(view), SIZE), 0)


def correlation(a, b):
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


@pytest.mark.parametrize("angle", [45.0, 75.0, 110.0])
def test_streaks_are_found(scene, angle):
    covers = layers(angle)
    even = float(np.median(covers))
    streaks = watch(rained_on(scene, covers), learned(scene), even, 15 * round(angle / 15))
    found = np.stack([alpha_of(streaks, view, even) for view in range(COUNT)])
    assert correlation(found, covers) > 0.75
    assert np.mean((found - covers) ** 2) < 0.5 * np.mean((covers - even) ** 2)
    heavy, guessed = covers > np.quantile(covers, 0.9), found > np.quantile(covers, 0.9)
    assert (heavy & guessed).sum() > 0.6 * guessed.sum()
    assert (heavy & guessed).sum() > 0.25 * heavy.sum()


def test_the_filter_adds_what_a_prior_leaves(scene):
    covers = layers()
    even = float(np.median(covers))
    priors = [((cover - even) / 2).astype(np.float32) for cover in covers]
    photographs, known = rained_on(scene, covers), learned(scene)
    found = [watch(photographs, known, even, priors=given) for given in ((None,) * COUNT, priors)]

    def error(deviations):
        return np.mean([(np.maximum(even + deviations[v], 0) - covers[v]) ** 2 for v in range(COUNT)])

    alone, both = (error([streaks.deviation(view) for view in range(COUNT)]) for streaks in found)
    assert both < 0.7 * error(priors)
    assert both < 0.7 * alone


def test_how_far_a_photograph_is_towards_rain_is_the_plain_formula():
    rng = np.random.default_rng(0)
    photograph, seen = rng.uniform(0, 1, (2, 9, 14, 3)).astype(np.float32)
    contrast = np.maximum(BETA - seen, 0) / (1 - 0.1)
    length = np.sqrt((contrast**2).sum(axis=2))
    along, reach = along_rain(photograph, seen, 0.1, BETA)
    assert np.allclose(reach, length, atol=1e-5)
    assert np.allclose(along, ((photograph - seen) * contrast).sum(axis=2) / np.maximum(length, 1e-3), atol=1e-5)


def test_what_was_found_is_kept_until_it_is_found_anew(scene):
    photographs = rained_on(scene, layers())
    streaks = watch(photographs, learned(scene), 0.15, rounds=4)
    before = [streaks.deviation(view) for view in range(COUNT)]
    streaks.renew()
    assert all(streaks.due(view) for view in range(COUNT))
    again = SingleStreaks((SIZE,) * COUNT, VISITS)
    again.load_state_dict(streaks.state_dict())
    assert all(np.array_equal(again.deviation(view), before[view]) for view in range(COUNT))
    for _ in range(2):
        for view in range(COUNT):
            seen = (scene[view] * 0.85 + 0.15 * BETA).astype(np.float32)
            streaks.update(*along_rain(photographs[view], seen, 0.15, BETA), 75, view)
    assert correlation(streaks.deviation(0), layers()[0]) > correlation(before[0], layers()[0])


def test_what_was_found_is_the_mean_over_visits():
    streaks = SingleStreaks([SIZE], VISITS)
    dry = np.zeros(SIZE, np.float32), np.full(SIZE, 0.5, np.float32), 75, 0
    streaks.update(*dry)  # its power
    for deviation in (0.2, 0.6):
        streaks.update(*dry, np.full(SIZE, deviation, np.float32))
    assert np.allclose(streaks.deviation(0), 0.4, atol=0.005)


@pytest.mark.parametrize("width", [80, 81])
def test_power_along_one_direction_is_passed_across_it(width):
    """Waves that run across rain of 45 degrees: up and to the left."""
    down, right = fft.fftfreq(64)[:, None], fft.rfftfreq(width)[None]
    power = np.ones((64, width // 2 + 1)) + 9 * ((down * right > 0.01) & (np.abs(np.abs(down) - right) < 0.05))
    gain = wiener_gain(power, width, 45, 1)
    assert gain[power > 5].mean() == pytest.approx(0.9, abs=0.01)
    assert gain[power < 5].max() == 0
    assert wiener_gain(power, width, 135, 1).max() < 0.01


EAGER = RainConfig(
    mist=None, drops=None, occlusion=None, rainfall=RainfallConfig(rainy=0.07, visits=2), enhanced=0, start=0
)


def objective_of(photographs, config=EAGER, hidden=(), network=None):
    images = TrainingImages([to_uint8(photograph) for photograph in photographs], hidden)
    return RainObjective(images, 100, config, network=network)


def network_of(scene):
    """What a network that errs makes of the photographs."""
    return PretendedNetwork(learned(scene, seed=9))


@pytest.mark.parametrize("with_network", [False, True])
def test_in_a_training_streaks_lower_the_loss_and_it_resumes_exactly(scene, with_network):
    photographs, network = rained_on(scene, layers()), network_of(scene) if with_network else None
    objectives = [objective_of(photographs, network=network) for _ in range(3)]
    everything = resumed(*objectives, learned(scene), 35, 65)
    assert "rain" in objectives[0].report()["needed"]
    assert objectives[0].report()["streaks"] > 0.01
    assert all(now < 0.9 * before for (before, _), (now, _) in zip(everything[:10], everything[-10:], strict=False))


def test_a_network_helps_where_it_rains(scene):
    covers = layers()
    errors = []
    for network in (None, network_of(scene)):
        objective = objective_of(rained_on(scene, covers), network=network)
        steps(objective, learned(scene), 0, 44)
        rain = objective.model.rainfall
        found = [rain.deviation(view) - (covers[view] - np.median(covers)) for view in range(COUNT)]
        errors.append(np.mean(np.square(found)))
    assert errors[1] < 0.8 * errors[0]
    assert objective.settings()["network"] == "of a test"
    alpha = objective.model.rain_alpha(0, SIZE)
    assert correlation(alpha, covers[0]) > 0.8
    assert alpha.mean() == pytest.approx(covers[0].mean(), abs=0.05)


def test_what_is_hidden_has_no_streaks_and_does_not_thin_the_rain_that_a_network_sees(scene):
    covers = layers()
    hidden = np.zeros(SIZE, bool)
    hidden[50:] = True
    objective = objective_of(rained_on(scene, covers), hidden=[hidden] * COUNT, network=network_of(scene))
    steps(objective, learned(scene), 0, 44)
    rain = objective.model.rainfall
    medians, count = rain.predicted
    assert count
    assert medians / count == pytest.approx(np.median(covers[:, :50]), abs=0.03)
    found = np.stack([rain.deviation(view) for view in range(COUNT)])
    assert found[:, :50].any()
    assert not found[:, 50:].any()


def certain_rain(certainty=1.0):
    """Rain that is known to fall, whose single streaks are looked for; and what they are told."""
    rain, told = Rainfall([SIZE], 100, 99, EAGER.rainfall), []
    rain.alpha[0], rain.certainty = 0.2, lambda: certainty
    rain.streaks.update = lambda along, contrast, *_: told.append((along, contrast))
    return rain, told


def test_single_streaks_are_looked_for_only_where_it_surely_rains_and_pixels_have_weight(scene):
    """Behind drops and masks a photograph is not the scene in rain."""
    assert not certain_rain(0.9)[0].due(0, SIZE, 30)
    rain, told = certain_rain()
    assert rain.due(0, SIZE, 30)
    weights = np.zeros(SIZE, np.float32)
    weights[:50] = 1
    rain.update(Observation(scene[0] + np.float32(0.05), None, None, weights), scene[0], 0, 30)
    for plane in told[0]:
        assert plane[:50].any()
        assert not plane[50:].any()
