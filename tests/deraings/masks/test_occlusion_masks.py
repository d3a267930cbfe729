"""Occlusion masks: the rule leads where its closed form says, interruptions leave no trace; their loss is exact."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from baselines.splatting.kernels.loss_map import loss_map
from baselines.splatting.kernels.photometric import prepare_target
from baselines.training.images import TrainingImages
from deraings.masks.config import MaskConfig
from deraings.masks.maps import evidence
from deraings.masks.network import MaskNetwork, high_pass, masked_loss, spectral_pooling
from deraings.masks.occlusion_masks import LEAST_TYPICAL, OcclusionMasks
from hydroviews.metrics.ssim import ssim_map
from hydroviews.scene.images import to_uint8

SIZE = HEIGHT, WIDTH = 46, 70  # no multiples of what the network works at
ALWAYS = MaskConfig(start=1e-9, every=1, rate=1e-2, min_evidence=0)
PAPER = replace(ALWAYS, regularisation=1.0, penalty=0.0)


def drop_pictures(seed, count=4, fixed=False):
    """Dim, noisy pictures with a bright square drop each, and where the drops are; `fixed` ones cannot be seen."""
    rng = np.random.default_rng(seed)
    pictures = rng.integers(40, 120, (count, HEIGHT, WIDTH, 3)).astype(np.uint8)
    drops = np.zeros((count, HEIGHT, WIDTH), bool)
    for k in range(count):
        top, left = (16, 24) if fixed else (rng.integers(4, HEIGHT - 20), rng.integers(4, WIDTH - 20))
        drops[k, top : top + 16, left : left + 16] = True
    if not fixed:
        pictures[drops] = 230
    return pictures, drops


def losses(drops, seed=0):
    """0.05 +- a fifth where it is dry, four times that in drops."""
    noise = np.random.default_rng(seed).uniform(0.8, 1.2, drops.shape)
    return (np.where(drops, 0.2, 0.05) * noise).astype(np.float32)


PICTURES, DROPS = drop_pictures(0)


def untaught(pictures=PICTURES, config=ALWAYS, seed=0, known=None, **more):
    return OcclusionMasks(TrainingImages(list(pictures)), 1000, seed, config, known, **more)


def taught(pictures, losses, config=ALWAYS, lessons=100, views=None, **more):
    """Masks that have learned from the first views, or from all of them."""
    masks, count = untaught(pictures, config, **more), views or len(pictures)
    for i in range(lessons):
        masks.learn(-i % count, losses[-i % count], i)
    return masks


@pytest.mark.parametrize("penalty", [0.0, 0.1])
def test_a_free_mask_ends_at_the_closed_form(penalty):
    loss = torch.tensor(np.random.default_rng(0).uniform(0, 0.5, (12, 16)), dtype=torch.float32)
    logits = torch.zeros_like(loss, requires_grad=True)
    adam = torch.optim.Adam([logits], 0.15)
    for _ in range(300):
        adam.zero_grad()
        masked_loss(torch.sigmoid(logits), loss, 0.15, penalty).backward()
        adam.step()
    expected = ((loss - penalty) / 0.3).clamp(0, 1)
    assert (expected == 1).any()
    assert (torch.sigmoid(logits) - expected).abs().max() < 0.02


@pytest.mark.parametrize(("config", "scale"), [(PAPER, 0.5), (PAPER, 5.0), (ALWAYS, 1.0)])
def test_the_network_ends_near_the_closed_form_at_any_level_of_loss(config, scale):
    """Drops lie in the same place in all views, so that all that the network finds is masked."""
    pictures, drops = drop_pictures(0, fixed=True)
    masks = taught(pictures, scale * losses(drops), config)
    found = np.stack([masks.mask(k, SIZE) for k in range(len(pictures))])
    assert masks.typical == pytest.approx(0.05 * scale, rel=0.1)
    excess = np.where(drops, 0.2, 0.05) * scale - config.penalty * masks.typical
    expected = np.clip(excess / (2 * config.regularisation * masks.typical), 0, 1)
    assert np.abs(found - expected).mean() < 0.08
    assert found[drops].mean() > 0.85
    assert found[~drops].mean() == pytest.approx(0.5 if config is PAPER else 0, abs=0.1)


@pytest.mark.parametrize(("fixed", "least", "most"), [(True, 0.8, 1.0), (False, 0.1, 0.5)])
def test_no_more_is_hidden_than_stays_on_the_lens(fixed, least, most):
    """Of four views each has a drop of its own where they are not fixed: a quarter of them shows it in its place."""
    pictures, drops = drop_pictures(0, fixed=fixed)
    masks = taught(pictures, losses(drops))
    found = np.stack([1 - masks.weights(k, SIZE, 500) for k in range(len(pictures))])
    assert least < found[drops].mean() < most
    assert found[~drops].mean() < 0.1
    assert masks.report()["mask_mean"] == pytest.approx(found.mean(), abs=0.02)


def test_the_network_learns_the_same_on_a_gpu(pretended_gpu):
    here, there = (taught(PICTURES, losses(DROPS), lessons=12, device=device) for device in ("cpu", "cuda"))
    assert pretended_gpu.counts["uploads"] >= 12 * 3  # picture, losses and what other views lose, in every lesson
    assert there.mask(0, SIZE) == pytest.approx(here.mask(0, SIZE), abs=2 / 255)
    again = untaught(seed=1, device="cuda")
    again.load_state_dict(there.state_dict())
    for masks in (there, again):
        masks.learn(0, losses(DROPS)[0], 12)
    assert np.array_equal(again.mask(0, SIZE), there.mask(0, SIZE))


def test_pictures_never_seen_are_masked_alike():
    pictures, drops = drop_pictures(0, count=8)
    unseen, hidden = drop_pictures(9)
    masks = taught(np.concatenate([pictures, unseen]), losses(drops), lessons=80, views=8)
    found = np.stack([masks.mask(8 + k, SIZE) for k in range(4)])
    assert found[hidden].mean() > found[~hidden].mean() + 0.25


def test_drops_that_cannot_be_seen_are_found_by_their_place_on_the_lens():
    pictures, drops = drop_pictures(0, fixed=True)
    found = taught(pictures, losses(drops), lessons=48, views=3).mask(3, SIZE)
    assert found[drops[3]].mean() > found[~drops[3]].mean() + 0.25


@pytest.mark.parametrize("views", [8, 35, 200])
@pytest.mark.parametrize("share", [0.0, 0.06, 0.25])
def test_evidence_is_the_share_of_detail_in_common_of_any_number_of_views(views, share):
    rng = np.random.default_rng(0)
    sky = 5 * np.linspace(0, 1, 60, dtype=np.float32)[:, None]  # what is coarse is no sign of drops
    own, common = rng.standard_normal((views, 60, 80), np.float32), rng.standard_normal((60, 80), np.float32)
    losses = sky + np.float32(np.sqrt(1 - share)) * own + np.float32(np.sqrt(share)) * common
    assert evidence(list(losses)) == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("fixed", [True, False])
def test_masks_are_used_only_where_something_is_on_the_lens(fixed):
    pictures, drops = drop_pictures(0, count=8, fixed=fixed)
    config = replace(ALWAYS, min_evidence=0.1)
    masks = taught(pictures, losses(drops), config, lessons=8)
    assert masks.due(9)
    weights = masks.weights(0, SIZE, 9)
    assert (weights is not None) == masks.due(10) == masks.report()["used"] == fixed
    assert masks.mask(0, SIZE).any() == fixed
    again = untaught(pictures, config)
    again.load_state_dict(masks.state_dict())
    assert again.report() == masks.report()


def test_a_scene_that_is_fitted_is_hardly_masked():
    masks = taught(PICTURES, 1e-2 * losses(DROPS), lessons=40)
    assert masks.typical == LEAST_TYPICAL
    assert masks.mask(0, SIZE).max() < 0.15


def test_nothing_is_masked_before_the_start_and_nothing_learnt_before_the_lessons():
    masks = untaught(config=MaskConfig(start=0.5, every=4, min_evidence=0))
    before = masks.state_dict()
    masks.learn(0, losses(DROPS)[0], 299)
    assert all(value.tobytes() == before[name].tobytes() for name, value in masks.state_dict().items())
    assert [i for i in range(290, 310) if masks.due(i)] == [300, 304, 308]
    masks.learn(0, losses(DROPS)[0], 300)
    assert masks.state_dict()["level"][1] == 1
    assert masks.weights(0, SIZE, 499) is None
    assert np.array_equal(masks.weights(0, SIZE, 500), 1 - masks.mask(0, SIZE))


@pytest.mark.parametrize("shape", [(46, 70), (1, 1), (5, 7), (33, 31), (129, 3)])
def test_pictures_of_any_sizes_learn_together(shape):
    rng, sizes = np.random.default_rng(0), [shape, shape[::-1], (24, 36)]
    masks = untaught([rng.integers(0, 256, (*size, 3)).astype(np.uint8) for size in sizes])
    for i, size in enumerate([*sizes, *sizes]):
        masks.learn(i % 3, rng.random(size, np.float32), i)
    for view, (height, width) in enumerate(sizes):
        for asked in ((height, width), (max(1, height // 2), max(1, width // 2))):
            mask = masks.mask(view, asked)
            assert (mask.shape, mask.dtype) == (asked, np.float32)
            assert ((mask >= 0) & (mask <= 1)).all()


def test_a_loss_that_says_nothing_teaches_nothing_and_broken_pixels_do_not_spoil_the_network():
    broken = losses(DROPS)
    broken[:, 5, 6:9], broken[:, 7, 7] = np.nan, np.inf
    masks = taught(PICTURES, broken, lessons=3)
    before = masks.state_dict()
    assert np.isfinite(masks.mask(0, SIZE)).all()
    assert all(np.isfinite(value).all() for value in before.values())
    for value in (0.0, np.nan):
        masks.learn(0, np.full(SIZE, value, np.float32), 9)
        assert all(array.tobytes() == before[name].tobytes() for name, array in masks.state_dict().items())


def test_seeds_and_other_peoples_random_numbers_and_threads():
    torch.manual_seed(3)
    state, threads = torch.get_rng_state(), torch.get_num_threads()
    one = taught(PICTURES, losses(DROPS), lessons=3).state_dict()
    assert torch.equal(torch.get_rng_state(), state)
    assert torch.get_num_threads() == threads
    torch.manual_seed(4)
    torch.set_num_threads(2)
    same, other = (taught(PICTURES, losses(DROPS), lessons=3, seed=seed).state_dict() for seed in (0, 1))
    torch.set_num_threads(threads)
    assert all(value.tobytes() == same[name].tobytes() for name, value in one.items())
    assert any(value.tobytes() != other[name].tobytes() for name, value in one.items())


UNSURE = replace(ALWAYS, min_evidence=1.1)


def told_once(config=ALWAYS, known=None, wet=False):
    """Masks after one lesson, to which it is told of each view what hides it."""
    masks = untaught(config=config, known=None if known is None else lambda view: known, wet=wet)
    masks.learn(0, losses(DROPS)[0], 0)
    return masks


def test_what_is_known_to_be_hidden_is_hidden_as_well():
    hidden = np.zeros(SIZE, np.float32)
    hidden[30:40, 50:60] = 0.5
    before, after = (1 - told_once(known=known).weights(0, SIZE, 500) for known in (None, hidden))
    np.testing.assert_allclose(after[32:38, 52:58], 0.5 + 0.5 * before[32:38, 52:58], atol=1e-3)
    np.testing.assert_array_equal(after[12:20, 12:20], before[12:20, 12:20])
    assert told_once(UNSURE, hidden).weights(0, SIZE, 500) is None


def test_where_drops_are_known_to_stay_losses_need_not_tell():
    told = told_once(UNSURE, np.full(SIZE, 0.5, np.float32), wet=True)
    assert told.weights(0, SIZE, 500).max() <= 0.5
    assert told.report()["used"]


def test_a_mask_is_at_most_one_where_what_is_known_is_more_by_rounding():
    masks = told_once(known=np.full(SIZE, np.nextafter(np.float32(1), np.float32(2))), wet=True)
    assert (masks.mask(0, SIZE).max(), masks.weights(0, SIZE, 500).min()) == (1, 0)


def test_the_typical_loss_is_of_pixels_that_are_shown():
    """Hidden ones have none, and may be most of a photograph."""
    masks, loss = untaught(), np.zeros(SIZE, np.float32)
    loss[:, :20] = 0.1
    masks.learn(0, loss, 0)
    assert masks.typical == pytest.approx(0.1)


def pictures():
    rng = np.random.default_rng(0)
    target = np.round(255 * rng.random((23, 31, 3), np.float32)) / np.float32(255)
    return np.clip(target + rng.normal(0, 0.1, target.shape), 0, 1).astype(np.float32), target


def loss_of(picture, target, ignored=None):
    return loss_map(picture, prepare_target(to_uint8(target), ignored)).copy()


def test_the_map_is_l1_and_ssim_of_each_pixel():
    image, target = pictures()
    padded = (np.pad(x, ((5, 5), (5, 5), (0, 0))) for x in (image, target))
    similarity = ssim_map(*(torch.from_numpy(x).double().permute(2, 0, 1)[None] for x in padded))[0]
    expected = 0.8 * np.abs(image - target).mean(axis=2) + 0.2 * (1 - similarity.mean(dim=0).numpy())
    assert np.abs(loss_of(image, target) - expected).max() < 1e-4


def test_hidden_pixels_have_no_loss_and_leave_no_trace():
    image, target = pictures()
    ignored = np.zeros(image.shape[:2], bool)
    ignored[4:15, 6:20] = True
    spoilt = np.where(ignored[..., None], np.float32(np.nan), image)
    found = loss_of(image, target, ignored)
    assert (found[ignored] == 0).all()
    assert np.array_equal(found, loss_of(spoilt, target, ignored))


@pytest.mark.parametrize("shape", [(16, 20), (15, 21), (1, 7), (9, 1)])
@pytest.mark.parametrize("cutoff", [0.0, 0.125, 0.3])
def test_spectral_pooling_is_the_rms_of_the_high_passed_map(shape, cutoff):
    features = torch.randn(2, 3, *shape, generator=torch.Generator().manual_seed(0))
    passed = torch.fft.irfft2(torch.fft.rfft2(features) * high_pass(*shape, cutoff), s=shape)
    assert passed.mean(dim=(2, 3)).abs().max() < 1e-6  # so the mean would tell nothing
    assert torch.allclose(spectral_pooling(features, cutoff), (passed**2).mean(dim=(2, 3)).sqrt(), atol=2e-6)


@pytest.mark.parametrize("attention", [True, False])
def test_every_weight_learns(attention):
    """From one of several starts: in a network as narrow as this a rectifier may shut all of a layer off."""
    picture = torch.rand(1, 3, 66, 70, generator=torch.Generator().manual_seed(0))
    silent = []
    for seed in range(4):
        torch.manual_seed(seed)
        network = MaskNetwork(shrink=2, fine=1, width=8, cutoff=0.125, attention=attention)
        assert any("mlp" in name for name, _ in network.named_parameters()) == attention
        descent = torch.optim.SGD(network.parameters(), 0.1)
        for _ in range(2):  # the last layer starts at zero and lets nothing through at first
            descent.zero_grad()
            (network(picture) * picture[:, :1, ::2, ::2]).sum().backward()
            descent.step()
        silent.append({name for name, p in network.named_parameters() if p.grad is None or not p.grad.abs().sum() > 0})
    assert set.intersection(*silent) == set()
