"""Pairs of rainy and clean pictures, and what a network learns from them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from tiny_network import TINY
from wet import HEIGHT, WIDTH, lens, photograph

from baselines.supervised.config import Intervals
from baselines.supervised.training import draw_ahead, train
from deraings.enhancement.architecture.lens_statistics import COARSE, FINE, lens_statistics
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.data import Data, started_from
from deraings.enhancement.training.loss import cover_loss, enhancement_loss, error_loss
from deraings.enhancement.training.pair_folders import PairFolder, find_pairs
from deraings.enhancement.training.pairs import MISTED, Batches, Pairs, Sample, sensed, stored
from deraings.enhancement.training.training import EnhancementTraining
from deraings.enhancement.weights import FILES
from hydroviews.errors import InputError
from hydroviews.pairs.drawing import Pair, shares_without
from hydroviews.pairs.rainy_pairs import DrawnRain
from hydroviews.scene.images import write_png
from hydroviews.scene.seeds import generator

CONFIG = TrainingConfig(network=TINY, steps=6, batch=2, patch=32, warm_up=2)
INTERVALS = Intervals(checkpoint_seconds=0.0, validate_every=3)
SELDOM = Intervals(checkpoint_seconds=3600.0, validate_every=60)  # a checkpoint takes as long as many steps


class Brighter(DrawnRain):
    """Pictures that rain has made brighter by a fifth."""

    def __init__(self):
        super().__init__([{48: np.full((48, 40, 3), 100, np.uint8)}], {})

    def pair(self, rng):
        clean = rng.uniform(0, 0.8, (48, 40, 3)).astype(np.float32)
        unknown, others = np.full((48, 40, 4), np.nan, np.float32), clean[None, ::2, ::2] + np.float32(0.2)
        return Pair(clean + np.float32(0.2), clean, np.full_like(clean, 0.25), unknown, others)


def learn(folder, config=CONFIG, source=None, start=None, intervals=INTERVALS):
    pairs = Pairs(source or Brighter(), [], config.patch, config.seed, misted=1)
    training = EnhancementTraining(config, start=start)
    train(training, Batches(pairs, config.batch), folder, "brighter", lambda _: {}, intervals)
    return training


def flat(network):
    return torch.cat([p.flatten() for p in network.parameters()])


@pytest.fixture(scope="module")
def skilled(tmp_path_factory):
    """A training that was long enough."""
    config = replace(CONFIG, steps=60, rate=6e-3, averaging=0.9)
    return learn(tmp_path_factory.mktemp("skilled"), config, intervals=SELDOM)


def test_training_removes_what_it_can(skilled):
    rainy, clean = torch.full((1, 3, 32, 32), 0.6), torch.full((1, 3, 32, 32), 0.4)
    assert (skilled.averaged(rainy) - clean).abs().mean() < 0.08
    assert skilled.losses["loss"] < 1


def test_a_training_begins_with_weights(skilled, tmp_path):
    start, still = skilled.averaged, replace(CONFIG, steps=2, rate=1e-9)
    assert torch.allclose(flat(learn(tmp_path, still, start=start).averaged), flat(start), atol=1e-5)
    assert not torch.allclose(flat(EnhancementTraining(CONFIG).averaged), flat(start), atol=1e-3)


@pytest.mark.parametrize("lacking", [{"cover": ()}, {"lens_mist": False, "lens_fine": False}])
def test_a_training_begins_with_weights_of_a_network_that_lacks_parts(tmp_path, lacking):
    network = EnhancementNetwork(replace(TINY, **lacking))
    torch.nn.init.normal_(network.head[0].weight, std=0.01)
    FILES.save(tmp_path / "start.safetensors", network, {"data": "nothing", "steps": 0})
    data = Data((tmp_path,), start=str(tmp_path / "start.safetensors"))
    start = started_from(data, CONFIG).network
    begun = EnhancementTraining(CONFIG, start=start).averaged
    chance = torch.Generator().manual_seed(1)
    rainy = torch.rand(1, 3, 32, 32, generator=chance)
    lens = lens_statistics(torch.rand(3, 3, 16, 16, generator=chance))
    with torch.no_grad():
        assert (start(rainy) - rainy).abs().max() > 1e-3
        for statistics in ((), (lens.coarse[None], lens.fine[None])):  # parts that learned nothing yet add nothing
            assert torch.allclose(begun(rainy, *statistics), start(rainy), atol=1e-6)
        assert begun.predict(rainy).cover.shape == rainy.shape
    with pytest.raises(InputError, match="cannot begin a training of another network"):
        started_from(data, TrainingConfig())


def test_loss_is_the_share_of_the_rain_that_is_left():
    clean = torch.zeros(2, 3, 16, 16)
    rainy = clean + torch.tensor([0.1, 0.4]).reshape(2, 1, 1, 1)
    half = clean + 0.5 * rainy
    assert enhancement_loss(rainy, clean, rainy, 0.0, 0.0, 0.0) == pytest.approx(1)
    assert enhancement_loss(half, clean, rainy, 0.0, 0.0, 0.0) == pytest.approx(0.5)
    assert enhancement_loss(clean, clean, clean, 0.1, 0.1, 0.02) == 0
    assert enhancement_loss(clean + 0.01, clean, clean, 0.0, 0.0, 0.02) == pytest.approx(0.5)


def error_of(kind, weights):
    """The loss of noise, or of an even error as large, with these weights of coefficients and squares."""
    noise = 0.1 * torch.randn(1, 3, 64, 64, generator=torch.Generator().manual_seed(0))
    error = noise if kind == "noise" else torch.full_like(noise, noise.abs().mean())
    return float(enhancement_loss(error, torch.zeros_like(noise), torch.ones_like(noise), *weights, 0.0))


def test_noise_is_as_large_in_coefficients_as_in_pixels():
    pixels, both = (error_of("noise", weights) for weights in ((0.0, 0.0), (1.0, 0.0)))
    assert (both - pixels) / pixels == pytest.approx(np.pi / 2 / np.sqrt(2), rel=0.05)  # Rayleigh, half-normal


def test_squares_see_what_is_smooth_and_coefficients_what_is_not():
    noise, smooth = (error_of(kind, (0.0, 0.0)) for kind in ("noise", "smooth"))
    assert noise == pytest.approx(smooth)
    assert error_of("smooth", (0.0, 1.0)) == pytest.approx(2 * smooth)
    assert error_of("noise", (0.0, 1.0)) < 1.2 * noise
    assert error_of("smooth", (1.0, 0.0)) < 1.2 * smooth


def test_cover_is_learned_where_it_is_known():
    found, cover = torch.zeros(1, 3, 4, 4), torch.full((1, 3, 4, 4), 0.5)
    assert cover_loss(found, cover) == pytest.approx(np.log(2))  # cross entropy, and nothing for overlap
    assert cover_loss(found + 9, torch.ones_like(cover)) < 1e-3 < cover_loss(found - 9, torch.ones_like(cover))
    cover[:, 1] = torch.nan
    assert cover_loss(found, cover) == pytest.approx(np.log(2))
    assert cover_loss(found, torch.full_like(cover, torch.nan)) == 0
    drop, missed = torch.zeros(1, 3, 64, 64), torch.full((1, 3, 64, 64), -9.0)
    drop[:, 1, 20:32, 20:32] = 1  # 3.5 % of the pixels: missed, it costs more than its share of them
    assert cover_loss(missed, drop) > 1.3 * 9 * drop.mean()  # what cross entropy alone says of it
    assert cover_loss(18 * drop - 9, drop) < 0.01


def test_the_network_finds_the_cover_and_says_nothing_of_what_nobody_knows(skilled):
    with torch.no_grad():
        found = skilled.averaged.predict(torch.rand(1, 3, 32, 32, generator=torch.Generator().manual_seed(0))).cover
    assert (found - 0.25).abs().mean() < 0.1
    unknown = EnhancementTraining(CONFIG)
    part, whole, box = torch.rand(1, 3, 32, 32), torch.rand(1, 2, 3, 128, 128), torch.tensor([[0.0, 1.0, 0.0, 1.0]])
    mist = torch.full((1, 2, 4, 128, 128), torch.nan)
    coarse, fine = torch.zeros(1, 2, COARSE, 16, 16), torch.zeros(1, FINE, 16, 16)
    unknown.learn(Sample(part, part, torch.full_like(part, torch.nan), box, whole, whole, mist, coarse, fine))
    assert all(torch.isfinite(p).all() for p in unknown.network.parameters())
    assert not unknown.network.cover.head.bias.any()


class PartlyHidden(Brighter):
    """Pictures whose lower half is noise that says nothing of what is behind."""

    def pair(self, rng):
        pair = super().pair(rng)
        rainy = pair.clean.copy()
        rainy[:, 20:] = rng.uniform(0, 0.8, (48, 20, 3))
        return pair._replace(rainy=rainy, cover=np.zeros_like(rainy), companions=np.zeros((0, 24, 20, 3), np.float32))


def test_a_network_learns_how_large_its_error_is(tmp_path):
    config = replace(CONFIG, network=replace(TINY, cover=(), error=True), steps=90, rate=1e-2, averaging=0.9, doubt=1.0)
    network = learn(tmp_path, config, PartlyHidden(), intervals=SELDOM).averaged
    rainy, clean, *_ = PartlyHidden().pair(np.random.default_rng(5))
    rainy, clean = (torch.from_numpy(picture[:32, :32].transpose(2, 0, 1).copy())[None] for picture in (rainy, clean))
    with torch.no_grad():
        found = network.predict(rainy)
    assert found.error.shape == (1, 1, 32, 32)
    assert 0.5 < found.error.mean() / (found.picture - clean).abs().mean() < 2


def test_the_loss_of_a_predicted_error_is_least_at_its_mean():
    clean, enhanced = torch.zeros(1, 3, 8, 8), torch.full((1, 3, 8, 8), 0.2)
    losses = [float(error_loss(torch.full((1, 1, 8, 8), s), enhanced, clean)) for s in (0.1, 0.19, 0.2, 0.21, 0.4)]
    assert min(losses) == losses[2]


def test_the_picture_is_not_traded_for_a_better_known_error():
    """What the picture depends on is changed by no weight of the error's loss."""
    pairs = Pairs(Brighter(), [], CONFIG.patch, CONFIG.seed, misted=1)
    learned = []
    for doubt in (0.0, 0.2):
        training = EnhancementTraining(replace(CONFIG, network=replace(TINY, error=True), doubt=doubt))
        training.clip = 1e9  # all weights share the norm of a gradient
        training.learn(Batches(pairs, 2)[0])
        learned.append(dict(training.network.named_parameters()))
    same = {name for name, p in learned[0].items() if torch.equal(p, learned[1][name])}
    assert same == {name for name in learned[0] if not name.startswith("error")}


def test_a_pair_depends_on_seed_and_number_alone():
    sides = {384: photograph(0, 256, 384), 480: photograph(1, 320, 480)}
    pool = {(384, 256): (lens(True, 256, 384),), (480, 320): (lens(True, 320, 480),)}
    source = DrawnRain([sides], pool, shares_without("window"))
    first = Pairs(source, [], 64, seed=0)
    for batch in draw_ahead(Batches(first, 2), 3, 4, workers=0):
        assert batch.rainy.shape == batch.clean.shape == batch.cover.shape == (2, 3, 64, 64)
        assert batch.whole_rainy.shape == batch.whole_clean.shape == (2, 1 + MISTED, 3, 128, 128)
        assert np.array_equal(batch.rainy[1], Pairs(source, [], 64, seed=0)[7][0])
    few = Pairs(source, [], 64, seed=0, misted=0)[7]
    assert few.whole_rainy.shape == (1, 3, 128, 128)
    assert np.array_equal(few.rainy, first[7].rainy)
    assert not np.array_equal(first[0][0], Pairs(source, [], 64, seed=1)[0][0])


class Ramp(DrawnRain):
    """A picture whose values say where they are."""

    def __init__(self):
        super().__init__([{96: photograph()}], {})

    def pair(self, rng):
        rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
        picture = np.stack([(rows + 0.5) / HEIGHT, (columns + 0.5) / WIDTH, np.ones_like(rows)], axis=-1)
        halves = picture.reshape(HEIGHT // 2, 2, WIDTH // 2, 2, 3).mean((1, 3))
        return Pair(picture, picture, picture, np.zeros((HEIGHT, WIDTH, 4), np.float32), halves[None])


def test_a_part_is_where_its_box_says():
    mirrored = 0
    for index in range(20):
        sample = Pairs(Ramp(), [], 32, 0)[index]
        top, bottom, left, right = sample.box.tolist()
        assert (bottom - top, right - left) == pytest.approx((32 / HEIGHT, 32 / WIDTH))
        assert sample.rainy[0].mean() == pytest.approx((top + bottom) / 2, abs=1e-5)
        is_mirrored = bool(sample.rainy[1, 0, 0] > sample.rainy[1, 0, -1])
        middle = float(sample.rainy[1].mean())
        assert (1 - middle if is_mirrored else middle) == pytest.approx((left + right) / 2, abs=1e-5)
        assert bool(sample.whole_rainy[0, 1, 0, 0] > sample.whole_rainy[0, 1, 0, -1]) == is_mirrored
        halves = torch.nn.functional.avg_pool2d(sample.rainy, 2)
        assert torch.allclose(sample.fine[:3], halves, atol=1e-5)  # the means of a picture and another like it
        assert bool(sample.coarse[0, 1, 0, 0] > sample.coarse[0, 1, 0, -1]) == is_mirrored
        mirrored += is_mirrored
    assert 0 < mirrored < 20


def write_pairs(folder, names):
    for i, name in enumerate(names):
        write_png(folder / name, photograph(i))


@pytest.mark.parametrize(
    ("rainy", "clean"),
    [
        ("train/input/0001.png", "train/target/0001.png"),  # 4K-Rain13k, UAV-Rain1k
        ("train/rain/norain-1x2.png", "train/norain/norain-1.png"),  # Rain100 in parts
        ("train/rainy/rain-001.png", "train/clean/norain-001.png"),
        ("train/rain-001.png", "train/norain-001.png"),  # the first release of Rain100
        ("train/input/12_3.png", "train/gt/12.png"),  # several rains of one photograph
    ],
)
def test_published_pairs_are_found(tmp_path, rainy, clean):
    write_pairs(tmp_path, [rainy, clean])
    assert find_pairs(tmp_path / "train") == [(tmp_path / rainy, tmp_path / clean)]


def test_published_pairs_that_do_not_fit_are_refused(tmp_path):
    write_pairs(tmp_path, ["input/a.png", "input/b.png", "target/a.png"])
    with pytest.raises(InputError, match="no clean picture"):
        find_pairs(tmp_path)
    (tmp_path / "input/b.png").unlink()
    write_png(tmp_path / "target/a.png", photograph(0))
    rainy, clean, cover, mist, companions = PairFolder(tmp_path, 32).pair(generator(0))
    assert companions.shape == (0, HEIGHT // 2, WIDTH // 2, 3)
    assert rainy.shape == cover.shape == (HEIGHT, WIDTH, 3)
    assert np.isnan(cover).all()
    assert np.isnan(mist).all()
    np.testing.assert_array_equal(rainy, clean)
    with pytest.raises(InputError, match="too small"):
        PairFolder(tmp_path, 128).pair(generator(0))
    with pytest.raises(InputError, match="no rainy and clean"):
        find_pairs(tmp_path / "target")


def test_a_rainy_picture_belongs_to_the_clean_one_whose_name_it_continues_furthest(tmp_path):
    write_pairs(tmp_path, ["input/1_2_3.png", "target/1.png", "target/1_2.png"])
    ((_, clean),) = find_pairs(tmp_path)
    assert clean.name == "1_2.png"


@pytest.mark.parametrize("change", [stored, sensed])
def test_a_camera_changes_a_pair_with_its_companions(change):
    """A lens is known from photographs as they are taken and stored, too."""
    rng = np.random.default_rng(0)
    sizes = (32, 48, 3), (32, 48, 3), (32, 48, 3), (32, 48, 4), (2, 16, 24, 3)
    pair = Pair(*(rng.random(size).astype(np.float32) for size in sizes))
    found = change(pair, rng)
    for before, after in ((pair.rainy, found.rainy), (pair.companions, found.companions)):
        assert 1e-3 < np.abs(before - after).mean() < 0.3
    assert change(pair._replace(rainy=pair.clean), rng).companions is pair.companions
