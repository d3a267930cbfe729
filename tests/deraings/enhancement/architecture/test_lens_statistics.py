"""What photographs say of their lens, and that a network that has not learned to listen is not changed by it."""

from dataclasses import replace

import numpy as np
import panorama
import pytest
import torch
from tiny_network import TINY

from baselines.training.images import TrainingImages
from deraings.enhancement.architecture.lens_statistics import (
    COARSE,
    FINE,
    LONGEST_RUN,
    coarse_statistics,
    fine_statistics,
    halved,
    lens_statistics,
    statistics_of_capture,
)
from deraings.enhancement.architecture.lenses import lenses_of_capture
from deraings.enhancement.architecture.mist_branch import mean_mist
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.enhance import enhance, predict, shipped
from deraings.enhancement.views import EnhancedViews
from deraings.enhancement.weights import Enhancer


def capture(count: int, height: int = 40, width: int = 52, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [rng.integers(0, 256, (height, width, 3)).astype(np.uint8) for _ in range(count)]


def planes(photographs) -> torch.Tensor:
    return torch.from_numpy(np.stack(photographs)).permute(0, 3, 1, 2).float() / 255


def enhanced_views(photographs, enhancer: Enhancer, folder, hidden=()) -> EnhancedViews:
    names = [f"view-{index}" for index in range(len(photographs))]
    return EnhancedViews(TrainingImages(photographs, hidden), names, enhancer, folder)


def statistics_of(photographs, *masks):
    return statistics_of_capture(len(photographs), photographs.__getitem__, *masks)


def as_image(photograph):
    return photograph.astype(np.float32) / 255


def test_fine_statistics_are_those_of_places():
    pictures = torch.rand(9, 3, 12, 16, generator=torch.Generator().manual_seed(0))
    found = fine_statistics(pictures)
    light = 0.299 * pictures[:, 0] + 0.587 * pictures[:, 1] + 0.114 * pictures[:, 2]
    assert found.shape == (FINE, 12, 16)
    assert torch.allclose(found[:3], pictures.mean(0))
    assert torch.allclose(found[3], light.amin(0), atol=1e-6)
    assert torch.allclose(found[4], light.sort(0).values[2], atol=1e-6)  # of nine the third is a quarter of the way up
    assert torch.allclose(found[5], 3 * light.std(0), atol=1e-5)
    around = torch.stack([light[:, 4:7, 6:9].mean((1, 2)), light[:, 5, 7]])
    assert found[6, 5, 7] == pytest.approx(10 * float((around[1] - around[0]).abs().mean()), abs=1e-5)
    assert torch.all(found[-1] == found[-1, 0, 0])


def test_coarse_statistics_know_the_darkest_that_is_seen_anywhere_in_a_cell():
    pictures = 0.5 + 0.5 * torch.rand(5, 3, 128, 128, generator=torch.Generator().manual_seed(0))
    pictures[3, :, 19, 34] = 0.25
    found = coarse_statistics(pictures)
    assert found.shape == (COARSE, 16, 16)
    lowest = found[18:21]
    assert torch.all(lowest[:, 2, 4] == 0.25)
    assert (lowest == 0.25).sum() == 3


def test_more_photographs_are_told_from_fewer_and_one_from_none():
    found = [lens_statistics(halved(planes(capture(count)))) for count in (1, 2, 5, 36)]
    counts = [each.coarse[-1, 0, 0].item() for each in found]
    assert counts[0] == 0
    assert counts == sorted(set(counts))
    assert not found[0].coarse.any()
    assert not found[0].fine.any()


@pytest.mark.parametrize("size", [(40, 52), (41, 51), (700, 30)])
def test_a_capture_is_summed_up_as_its_pictures_are(size):
    photographs = capture(4, *size)
    found, whole = statistics_of(photographs), lens_statistics(halved(planes(photographs)))
    assert all(one is found[0] for one in found)
    assert found[0].fine.shape == (FINE, -(-size[0] // 2), -(-size[1] // 2))
    assert torch.allclose(found[0].fine[:6], whole.fine[:6], atol=0.01)  # halves are kept in 8 bits
    assert torch.allclose(found[0].coarse, whole.coarse, atol=0.02)


def test_long_captures_are_taken_in_runs_and_sizes_apart():
    photographs = [*capture(LONGEST_RUN + 3, 8, 8), *capture(1, 8, 10)]
    read = []
    found = statistics_of_capture(len(photographs), lambda i: read.append(i) or photographs[i])
    assert read == list(range(len(photographs)))
    assert found[0] is found[25]
    assert found[0] is not found[26]
    assert found[-1] is None
    assert found[-2] is found[26]


def test_what_masks_hide_does_not_count():
    photographs, hidden = [np.full((40, 52, 3), 100, np.uint8) for _ in range(3)], np.zeros((40, 52), bool)
    clear = statistics_of(photographs)[0]
    hidden[10:20, 11:31] = True
    photographs[1] = np.where(hidden[..., None], 0, photographs[1]).astype(np.uint8)
    found = statistics_of(photographs, [None, hidden, None].__getitem__)[0]
    assert torch.allclose(found.fine, clear.fine, atol=1e-5)
    assert torch.allclose(found.coarse, clear.coarse, atol=1e-5)
    assert not torch.allclose(statistics_of(photographs)[0].fine, clear.fine, atol=0.1)


def listening(config=TINY) -> Enhancer:
    """A network that heeds statistics."""
    torch.manual_seed(0)
    network = EnhancementNetwork(config).requires_grad_(False)
    ends = [network.head[0], network.lens_fine[-1], network.mist.end]
    for layer in [*ends, network.lens_mist.end] if config.lens_mist else ends:
        torch.nn.init.normal_(layer.weight, std=0.05)
    return Enhancer(network, {}, "for a test")


def lenses_of(photographs, enhancer):
    return lenses_of_capture(len(photographs), photographs.__getitem__, enhancer.network)


def test_a_picture_alone_has_no_lens_nor_has_one_of_a_network_that_looks_at_none():
    photographs, enhancer = capture(5, 90, 150), listening()
    assert lenses_of(photographs[:1], enhancer) == [None]
    deaf = EnhancementNetwork(replace(TINY, lens_mist=False, lens_fine=False)).requires_grad_(False)
    assert lenses_of(photographs, Enhancer(deaf, {}, "for a test")) == [None] * 5


def test_one_mist_lies_on_one_lens_and_is_the_mean_of_what_its_photographs_show():
    photographs, enhancer = [*capture(LONGEST_RUN + 2, 16, 24)], listening()
    lenses = lenses_of(photographs, enhancer)
    assert len({id(lens) for lens in lenses}) == 2
    statistics = statistics_of(photographs)[0].coarse[None]
    first = [p for p, lens in zip(photographs, lenses, strict=True) if lens is lenses[0]]
    each = [enhancer.network.find_mist(planes([p]), statistics)[0] for p in first]
    assert torch.allclose(lenses[0].mist[0], torch.stack(each)[:, 0].mean(0), atol=1e-5)
    thick, none = torch.full((1, 4, 2, 2), 0.4), torch.cat([torch.zeros(1, 1, 2, 2), torch.ones(1, 3, 2, 2)], 1)
    assert torch.allclose(mean_mist(torch.cat([thick, none]))[1:], torch.tensor(0.4), atol=1e-3)
    assert torch.allclose(mean_mist(torch.cat([thick, none]))[0], torch.tensor(0.2))


def test_a_network_that_looks_for_no_mist_on_a_lens_looks_for_it_in_each_photograph(tmp_path):
    photographs, enhancer = capture(3, 32, 64), listening(replace(TINY, lens_mist=False))
    lens, image = lenses_of(photographs, enhancer)[0], as_image(photographs[0])
    assert lens.mist is None
    assert enhanced_views(photographs, enhancer, tmp_path).lens_mist(0) is None
    assert enhanced_views(photographs[:1], listening(), tmp_path).lens_mist(0) is None
    assert np.abs(enhance(image, enhancer, lens=lens) - enhance(image, enhancer, remove_mist=False, lens=lens)).any()


def test_training_views_are_enhanced_with_what_all_of_them_say(tmp_path):
    photographs = capture(3, 40, 64)
    views, lens = enhanced_views(photographs, listening(), tmp_path), lenses_of(photographs, listening())[1]
    image = as_image(photographs[1])
    np.testing.assert_allclose(views.image(1), enhance(image, listening(), lens=lens), atol=0.01)
    assert np.abs(views.image(1) - enhance(image, listening())).max() > 0.02
    assert len(views.files()) == 3
    cover = predict(image, listening(), lens=lens).cover
    np.testing.assert_allclose(views.small_drop_cover(1), cover[..., 1], atol=0.01)
    assert cover.std() > 0


def test_what_is_hidden_does_not_decide_how_much_mist_there_is(tmp_path):
    """Pixels that are hidden are black, and black is what mist would have lifted."""
    photographs = [np.clip(picture // 2 + 120, 0, 255).astype(np.uint8) for picture in capture(3, 64, 96)]
    hidden = np.zeros((64, 96), bool)
    hidden[40:] = True
    far = slice(36)  # rows; the network looks from the four others into what is hidden
    seen = enhanced_views(photographs, shipped(), tmp_path, [hidden] * 3).image(0)[far]
    for alike in (True, False):  # the mean of what is shown, black
        filled = [np.where(hidden[..., None], alike * p[~hidden].mean(0), p).astype(np.uint8) for p in photographs]
        expected = enhanced_views(filled, shipped(), tmp_path / str(alike)).image(0)[far]
        assert (np.abs(seen - expected).max() < 0.05) == alike


def test_holes_are_not_taken_for_drops(tmp_path):
    """Hidden pixels are filled evenly, and look like a drop."""
    photographs, hidden = capture(3, 64, 96), np.zeros((64, 96), bool)
    hidden[20:24, 30:34] = True
    cover = enhanced_views(photographs, listening(), tmp_path / "plain").small_drop_cover(0)
    holed = enhanced_views(photographs, listening(), tmp_path / "masked", [hidden] * 3).small_drop_cover(0)
    assert (holed[16:28, 26:38] == 0).all()
    assert cover[16:28, 26:38].mean() > 0.1
    assert (holed[:12] > 0).any()


def test_the_mist_on_a_lens_is_predicted(tmp_path):
    clean = panorama.views_of(panorama.paint(), 12)
    alpha, light = panorama.slanted_mist(0.1), np.full(3, 0.7, np.float32)
    misty = panorama.eight_bit(panorama.misted(clean, alpha, light))
    none = enhanced_views(panorama.eight_bit(clean), shipped(), tmp_path).lens_mist(0)
    some = enhanced_views(misty, shipped(), tmp_path).lens_mist(0)
    assert none.light.shape == none.error.shape == (16, 16)
    assert abs(np.median(none.light)) < 0.003
    assert np.median(some.light) == pytest.approx(0.7 * np.median(alpha), rel=0.5)
    assert some.light[:, -3:].mean() > 2 * some.light[:, :3].mean()


def test_the_error_of_the_mist_on_a_lens_is_that_of_the_mean_over_its_photographs(tmp_path):
    photographs, enhancer = capture(5, 32, 64), listening()
    found = enhanced_views(photographs, enhancer, tmp_path).lens_mist(2)
    coarse = statistics_of(photographs)[0].coarse[None]
    each = torch.cat([enhancer.network.find_mist(planes([p]), coarse) for p in photographs])
    added = (each[:, 0] * each[:, 1:].mean(1)).numpy()
    assert found.error == pytest.approx(added.std(axis=0, ddof=1) / np.sqrt(5), abs=1e-5)
    assert found.light == pytest.approx(added.mean(axis=0), abs=0.01)
    assert found.error.max() > 1e-4


def test_pictures_of_a_batch_with_and_without_companions_do_not_mix():
    network, pictures = listening().network, planes(capture(2, 32, 64))
    lens = lens_statistics(halved(planes(capture(3, 32, 64, seed=1))))
    coarse = torch.stack([lens.coarse, torch.zeros_like(lens.coarse)])
    fine = torch.stack([lens.fine, torch.zeros_like(lens.fine)])
    both = network(pictures, coarse, fine)
    assert torch.allclose(both[:1], network(pictures[:1], lens.coarse[None], lens.fine[None]), atol=1e-5)
    assert torch.allclose(both[1:], network(pictures[1:]), atol=1e-5)


@pytest.mark.parametrize("part", ["lens_mist", "lens_fine"])
def test_a_network_may_look_at_lenses_with_one_of_its_parts(part):
    config = replace(TINY, lens_mist=False, lens_fine=False)
    network = EnhancementNetwork(replace(config, **{part: True})).requires_grad_(False)
    own = network.lens_fine[-1] if part == "lens_fine" else network.lens_mist.end
    for layer in (network.head[0], own):
        torch.nn.init.normal_(layer.weight, std=0.05)
    lens, image = lens_statistics(halved(planes(capture(3, 32, 64)))), planes(capture(1, 32, 64, seed=2))
    changed = network.remove_mist(image, lens.coarse[None]) - network.remove_mist(image)
    refined = network.refine(image, lens.fine[None]) - network.refine(image)
    assert bool(changed.any()) == (part == "lens_mist")
    assert bool(refined.any()) == (part == "lens_fine")
    assert network.config.lens
