import csv
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import torch
from tiny_network import TINY

from baselines.training.checkpoints import CHECKPOINT
from baselines.training.network_commands import rounded
from baselines.training.supervised_training import CURVE, Intervals, rate_at
from deraings.enhancement.architecture.lens_statistics import COARSE, FINE
from deraings.enhancement.training.config import TrainingConfig
from deraings.enhancement.training.loop import EnhancementTraining, train
from deraings.enhancement.training.loss import cover_loss, enhancement_loss, error_loss
from deraings.enhancement.training.pairs import Pairs, Sample
from deraings.enhancement.weights import load_enhancer, save_network
from hydroviews.errors import InputError
from hydroviews.pairs.drawing import Pair
from hydroviews.pairs.rainy_pairs import DrawnRain

CONFIG = TrainingConfig(network=TINY, steps=6, batch=2, patch=32, warm_up=2, precision="float32")
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


class Interrupting(Brighter):
    """The same until the sixth pair is asked for."""

    def __init__(self):
        super().__init__()
        self.count = 0

    def pair(self, rng):
        self.count += 1
        if self.count > 5:
            raise KeyboardInterrupt
        return super().pair(rng)


def learn(folder, config=CONFIG, source=None, data="brighter", start=None, workers=0, intervals=INTERVALS):
    scores = iter(range(100))
    pairs = Pairs(source or Brighter(), [], config.patch, config.seed, misted=1)
    validate = lambda _: {"score": float(next(scores))}  # noqa: E731
    return train(folder, config, pairs, data, validate, intervals, start, workers)


def flat(network):
    return torch.cat([p.flatten() for p in network.parameters()])


def weights_of(training):
    return flat(training.averaged)


@pytest.fixture(scope="module")
def skilled(tmp_path_factory):
    """A training that was long enough."""
    config = replace(CONFIG, steps=60, rate=6e-3, averaging=0.9)
    return learn(tmp_path_factory.mktemp("skilled"), config, intervals=SELDOM)


def test_training_removes_what_it_can(skilled):
    rainy, clean = torch.full((1, 3, 32, 32), 0.6), torch.full((1, 3, 32, 32), 0.4)
    assert (skilled.averaged(rainy) - clean).abs().mean() < 0.08
    assert skilled.losses["loss"] < 1


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_an_interrupted_training_ends_with_the_same_bits(undisturbed, tmp_path, precision):
    config = replace(CONFIG, precision=precision)
    whole = undisturbed[1] if config == CONFIG else learn(tmp_path / "whole", config)
    with pytest.raises(KeyboardInterrupt):
        learn(tmp_path / "parts", config, Interrupting())
    parts = learn(tmp_path / "parts", config)
    assert parts.iteration == whole.iteration == 6
    assert torch.equal(weights_of(whole), weights_of(parts))
    assert whole.losses == parts.losses


def test_a_training_begins_with_the_weights_it_is_given_and_goes_on_from_its_own(undisturbed, skilled, tmp_path):
    start = skilled.averaged
    still = replace(CONFIG, rate=1e-9, final_rate=1e-9)
    assert torch.allclose(weights_of(learn(tmp_path / "still", still, start=start)), flat(start), atol=1e-6)
    whole = learn(tmp_path / "whole", start=start)
    assert not torch.equal(weights_of(whole), weights_of(undisturbed[1]))
    with pytest.raises(KeyboardInterrupt):
        learn(tmp_path / "parts", source=Interrupting(), start=start)
    assert torch.equal(weights_of(whole), weights_of(learn(tmp_path / "parts", start=start)))


def test_workers_do_not_change_the_result(undisturbed, tmp_path):
    helped = learn(tmp_path, workers=2)
    assert torch.equal(weights_of(undisturbed[1]), weights_of(helped))


def test_every_seed_is_another_training_and_zero_is_one(undisturbed, tmp_path):
    again, other = (learn(tmp_path / str(seed), replace(CONFIG, seed=seed)) for seed in (0, 1))
    assert torch.equal(weights_of(undisturbed[1]), weights_of(again))
    assert not torch.equal(weights_of(undisturbed[1]), weights_of(other))


def test_a_training_of_the_cover_begins_with_weights_that_predict_none(skilled, tmp_path):
    blind = replace(TINY, cover=())
    start = EnhancementTraining(replace(CONFIG, network=blind)).averaged
    begun = EnhancementTraining(CONFIG)
    begun.begin_with(start)
    rainy = torch.rand(1, 3, 32, 32, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        assert torch.equal(begun.averaged(rainy), start(rainy))  # an untrained cover adds nothing
        assert begun.averaged.predict(rainy).cover.shape == rainy.shape


def test_a_finished_training_is_not_trained_again(undisturbed, finished):
    assert torch.equal(weights_of(undisturbed[1]), weights_of(learn(finished, source=Interrupting())))


@pytest.mark.parametrize("changed", [{"config": replace(CONFIG, rate=1.0)}, {"data": "darker"}])
def test_a_checkpoint_of_another_training_is_refused(finished, changed):
    with pytest.raises(InputError, match="another run"):
        learn(finished, **changed)


def test_a_damaged_checkpoint_is_refused(finished):
    (finished / CHECKPOINT).write_bytes((finished / CHECKPOINT).read_bytes()[:1000])
    with pytest.raises(InputError, match="damaged"):
        learn(finished)


def test_the_curve_has_a_row_a_validation(undisturbed):
    rows = list(csv.DictReader((undisturbed[0] / CURVE).open()))
    assert [int(row["step"]) for row in rows] == [3, 6]
    assert [float(row["score"]) for row in rows] == [0, 1]
    assert all(0 < float(row["loss"]) < 3 for row in rows)


def test_the_rate_rises_and_falls():
    config = TrainingConfig(steps=100, warm_up=10, rate=1.0, final_rate=0.1)
    rates = [rate_at(step, config) for step in range(100)]
    assert rates[0] == pytest.approx(0.1)
    assert rates[9] == pytest.approx(1.0)
    assert rates[54] == pytest.approx(0.557, abs=0.01)
    assert rates[-1] == pytest.approx(0.1, abs=0.01)
    assert all(one >= other for one, other in pairwise(rates[9:]))


def test_loss_is_the_share_of_the_rain_that_is_left():
    clean = torch.zeros(2, 3, 16, 16)
    rainy = clean + torch.tensor([0.1, 0.4]).reshape(2, 1, 1, 1)
    half = clean + 0.5 * rainy
    assert enhancement_loss(rainy, clean, rainy, 0.0, 0.0, 0.0) == pytest.approx(1)
    assert enhancement_loss(half, clean, rainy, 0.0, 0.0, 0.0) == pytest.approx(0.5)
    assert enhancement_loss(clean, clean, clean, 0.1, 0.1, 0.02) == 0
    assert enhancement_loss(clean + 0.01, clean, clean, 0.0, 0.0, 0.02) == pytest.approx(0.5)


def test_noise_is_as_large_in_coefficients_as_in_pixels():
    noise = 0.1 * torch.randn(1, 3, 64, 64, generator=torch.Generator().manual_seed(0))
    clean, rainy = torch.zeros_like(noise), torch.ones_like(noise)
    pixels = enhancement_loss(noise, clean, rainy, 0.0, 0.0, 0.0)
    both = enhancement_loss(noise, clean, rainy, 1.0, 0.0, 0.0)
    assert float((both - pixels) / pixels) == pytest.approx(np.pi / 2 / np.sqrt(2), rel=0.05)  # Rayleigh, half-normal


def test_squares_see_what_is_smooth_and_coefficients_what_is_not():
    noise = 0.1 * torch.randn(1, 3, 64, 64, generator=torch.Generator().manual_seed(0))
    smooth, clean = torch.full_like(noise, noise.abs().mean()), torch.zeros_like(noise)
    loss = lambda error, *weights: float(enhancement_loss(error, clean, torch.ones_like(noise), *weights, 0.0))  # noqa: E731
    assert loss(noise, 0.0, 0.0) == pytest.approx(loss(smooth, 0.0, 0.0))
    assert loss(smooth, 0.0, 1.0) == pytest.approx(2 * loss(smooth, 0.0, 0.0))
    assert loss(noise, 0.0, 1.0) < 1.2 * loss(noise, 0.0, 0.0)
    assert loss(smooth, 1.0, 0.0) < 1.2 * loss(smooth, 0.0, 0.0)


def test_cover_is_learned_where_it_is_known():
    found, cover = torch.zeros(1, 3, 4, 4), torch.full((1, 3, 4, 4), 0.5)
    assert cover_loss(found, cover) == pytest.approx(np.log(2))  # cross entropy, and nothing for overlap
    assert cover_loss(found + 9, torch.ones_like(cover)) < 1e-3 < cover_loss(found - 9, torch.ones_like(cover))
    cover[:, 1] = torch.nan
    assert cover_loss(found, cover) == pytest.approx(np.log(2))
    assert cover_loss(found, torch.full_like(cover, torch.nan)) == 0


def test_a_missed_drop_costs_more_than_its_share_of_the_pixels():
    cover, missed = torch.zeros(1, 3, 64, 64), torch.full((1, 3, 64, 64), -9.0)
    cover[:, 1, 20:32, 20:32] = 1  # 3.5 % of the pixels
    entropy = 9 * cover.mean()  # what cross entropy alone says of it
    assert cover_loss(missed, cover) > 1.3 * entropy
    assert cover_loss(18 * cover - 9, cover) < 0.01


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


def test_a_gradient_that_is_not_finite_changes_no_weights():
    training = EnhancementTraining(CONFIG)
    before = [parameter.clone() for parameter in training.network.parameters()]
    part, whole, box = torch.rand(1, 3, 32, 32), torch.rand(1, 2, 3, 128, 128), torch.tensor([[0.0, 1.0, 0.0, 1.0]])
    mist = torch.full((1, 2, 4, 128, 128), torch.nan)
    with pytest.raises(FloatingPointError, match="network's gradient of iteration 0 is not finite: loss"):
        coarse, fine = torch.zeros(1, 2, COARSE, 16, 16), torch.zeros(1, FINE, 16, 16)
        cover = torch.full_like(part, torch.nan)
        training.learn(Sample(part * torch.inf, part, cover, box, whole, whole, mist, coarse, fine))
    assert all(torch.equal(a, b) for a, b in zip(before, training.network.parameters(), strict=True))


def test_weights_come_back_with_their_card(undisturbed, tmp_path):
    averaged = deepcopy(undisturbed[1].averaged)
    card = {"data": "brighter", "steps": 6}
    path = tmp_path / "weights.safetensors"
    save_network(path, TINY, averaged.state_dict(), card)
    enhancer = load_enhancer(path)
    assert enhancer.card == card
    assert "6 steps on brighter" in enhancer.reason
    assert str(path) in enhancer.reason
    image = torch.rand(1, 3, 32, 32)
    averaged.load_state_dict(rounded(averaged.state_dict()))
    assert torch.equal(enhancer.network(image), averaged(image))


def test_weights_that_are_not_there_or_of_something_else_are_refused(tmp_path):
    with pytest.raises(InputError, match="none of that name"):
        load_enhancer("enormous")
    with pytest.raises(InputError, match="no such file"):
        load_enhancer(tmp_path / "weights.safetensors")
    save_network(tmp_path / "other.safetensors", TINY, {"w": torch.zeros(1)}, {"data": "", "steps": 0})
    with pytest.raises(InputError, match="not an enhancement network"):
        load_enhancer(tmp_path / "other.safetensors")


class PartlyHidden(Brighter):
    """Pictures whose lower half is noise that says nothing of what is behind."""

    def pair(self, rng):
        clean = rng.uniform(0, 0.8, (48, 40, 3)).astype(np.float32)
        rainy = clean.copy()
        rainy[:, 20:] = rng.uniform(0, 0.8, (48, 20, 3))
        unknown, others = np.full((48, 40, 4), np.nan, np.float32), np.zeros((0, 24, 20, 3), np.float32)
        return Pair(rainy, clean, np.zeros_like(clean), unknown, others)


def test_a_network_learns_how_large_its_error_is(tmp_path):
    config = replace(CONFIG, network=replace(TINY, cover=(), error=True), steps=90, rate=1e-2, averaging=0.9, doubt=1.0)
    network = learn(tmp_path, config, PartlyHidden(), intervals=SELDOM).averaged
    pair = PartlyHidden().pair(np.random.default_rng(5))
    rainy = torch.from_numpy(pair.rainy[:32, :32].transpose(2, 0, 1).copy())[None]
    with torch.no_grad():
        found = network.predict(rainy)
    true = (found.picture - torch.from_numpy(pair.clean[:32, :32].transpose(2, 0, 1).copy())[None]).abs().mean()
    assert found.error.shape == (1, 1, 32, 32)
    assert 0.5 * true < found.error.mean() < 2 * true


def test_the_loss_of_a_predicted_error_is_least_at_its_mean():
    clean, enhanced = torch.zeros(1, 3, 8, 8), torch.full((1, 3, 8, 8), 0.2)
    losses = [float(error_loss(torch.full((1, 1, 8, 8), s), enhanced, clean)) for s in (0.1, 0.19, 0.2, 0.21, 0.4)]
    assert min(losses) == losses[2]


def test_the_picture_is_not_traded_for_a_better_known_error(tmp_path):
    """Weights of all parts but the error's are the same to the bit."""
    plain, doubting = CONFIG, replace(CONFIG, network=replace(TINY, error=True), doubt=5.0)
    networks = []
    for config in (plain, doubting):
        training = EnhancementTraining(config)
        training.network.load_state_dict(EnhancementTraining(plain).network.state_dict(), strict=False)
        pairs = Pairs(Brighter(), [], config.patch, config.seed, misted=1)
        batch = Sample(*(torch.stack(parts) for parts in zip(pairs[0], pairs[1], strict=True)))
        training._loss(batch).backward()
        networks.append({n: p.grad for n, p in training.network.named_parameters() if not n.startswith("error")})
    assert all(torch.equal(networks[0][n], networks[1][n]) for n in networks[0] if networks[0][n] is not None)
