"""What a network predicts of each photograph, kept on disk: pictures, covers, expected errors."""

from dataclasses import replace

import numpy as np
import pytest
from tiny_network import TINY

from baselines.training.images import TrainingImages
from deraings.enhancement import views as module
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.clear_pixels import DROPS
from deraings.enhancement.enhance import Enhanced
from deraings.enhancement.views import COVER_SIDE, EnhancedViews
from deraings.enhancement.weights import Enhancer
from hydroviews.errors import InputError

COUNT, SIZE, DRY = 4, (24, 32), 2
PREDICTING = replace(TINY, error=True)


@pytest.fixture(scope="module")
def photographs():
    rng = np.random.default_rng(0)
    pictures = [rng.integers(60, 200, (*SIZE, 3)).astype(np.uint8) for _ in range(COUNT)]
    pictures[DRY][0, 0] = 0
    return pictures


@pytest.fixture
def enhance(monkeypatch):
    """In place of the network: pictures darker by 0.1, covers that rise to the right, errors that are even.

    In the photograph DRY, known by its black corner, no rain is seen.
    """
    calls = []

    def predict(image, enhancer, *_):
        calls.append(image)
        cover = np.zeros(image.shape, np.float32)
        cover[..., DROPS] = np.linspace(0, 1, image.shape[1])
        cover *= image[0, 0, 0] > 0
        config = enhancer.network.config
        error = np.full(image.shape[:2], 0.05, np.float32)
        picture = np.clip(image - np.float32(0.1), 0, 1)
        return Enhanced(picture, cover if config.cover else None, error if config.error else None)

    monkeypatch.setattr(module, "predict", predict)
    return calls


def views_of(photographs, folder, config=PREDICTING, hidden=()):
    names = [f"view-{index}" for index in range(len(photographs))]
    enhancer = Enhancer(EnhancementNetwork(config).eval().requires_grad_(False), {}, "tiny")
    for value in enhancer.network.state_dict().values():
        value.zero_()  # the weights name the folder
    return EnhancedViews(TrainingImages(photographs, hidden), names, enhancer, folder)


def test_what_drops_cover_is_kept_small_and_its_mean_leaves_a_photograph_out(photographs, tmp_path, enhance):
    views = views_of(photographs, tmp_path)
    covers = [views.small_drop_cover(index) for index in range(COUNT)]
    others = [index for index in range(COUNT) if index != DRY]
    rising = np.broadcast_to(np.linspace(0, 1, SIZE[1]), SIZE)
    assert not covers[DRY].any()
    assert all(covers[index] == pytest.approx(rising, abs=0.005) for index in others)
    assert views.mean_drop_cover(DRY) == pytest.approx(rising, abs=0.005)  # nothing of its own
    assert views.mean_drop_cover(others[0]) == pytest.approx(2 / 3 * rising, abs=0.03)
    assert len(enhance) == COUNT


def test_covers_of_large_photographs_are_no_larger_than_they_need_be(tmp_path, enhance):
    large = [np.full((30, 2 * COVER_SIDE, 3), 90, np.uint8) for _ in range(2)]
    views = views_of(large, tmp_path)
    assert views.small_drop_cover(1).shape == views.small_error(1).shape == (15, COVER_SIDE)
    assert views.mean_drop_cover(0).shape == (15, COVER_SIDE)


def test_the_expected_error_is_kept_to_a_few_thousandths_and_what_exceeds_it_counts_of_a_change(
    photographs, tmp_path, enhance
):
    views = views_of(photographs, tmp_path)
    assert views.small_error(2) == pytest.approx(0.05, abs=0.003)
    again = views_of(photographs, tmp_path)
    assert np.array_equal(again.small_error(2), views.small_error(2))
    assert len(enhance) == 1
    assert views.change_over_error(1) == pytest.approx(0.1**2 / (0.1**2 + 0.05**2), abs=0.03)


def test_networks_that_predict_less_say_less(photographs, tmp_path, enhance):
    views = views_of(photographs, tmp_path, replace(TINY, error=False, cover=()))
    assert views.small_error(0) is None
    assert not views.tells_cover
    assert not views.drops_stay
    assert views.change_over_error(0) == pytest.approx(1)


def test_changes_within_the_expected_error_are_no_rain(photographs, tmp_path, enhance, monkeypatch):
    assert views_of(photographs, tmp_path / "rain").finds_rain

    def hardly(image, *_):
        return Enhanced(image + np.float32(0.01), None, np.full(image.shape[:2], 0.05, np.float32))

    monkeypatch.setattr("deraings.enhancement.views.predict", hardly)
    assert not views_of(photographs, tmp_path / "dry").finds_rain


def test_hidden_pixels_count_for_no_change(photographs, tmp_path, enhance):
    hidden = np.zeros(SIZE, bool)
    hidden[:12] = True
    black = [np.where(hidden[..., None], 0, picture).astype(np.uint8) for picture in photographs]
    plain = views_of(photographs, tmp_path / "plain").change_over_error(1)
    masked = views_of(black, tmp_path / "masked", hidden=[hidden] * COUNT).change_over_error(1)
    assert masked == pytest.approx(plain, abs=0.02)
    everything = views_of(black, tmp_path / "all", hidden=[np.ones(SIZE, bool)] * COUNT)
    assert everything.change_over_error(0) == 0


@pytest.mark.parametrize("missing", ["view-1.png", "cover/view-1.png", "error/view-1.png"])
def test_what_an_interruption_left_out_is_made_again(photographs, tmp_path, enhance, missing):
    first = views_of(photographs, tmp_path)
    picture, error = first.image(1), first.small_error(1)
    (kept,) = tmp_path.iterdir()
    (kept / missing).unlink()
    again = views_of(photographs, tmp_path)
    for _ in range(2):
        assert np.array_equal(again.image(1), picture)
        assert (kept / missing).is_file()
        assert np.array_equal(again.small_error(1), error)
        assert len(enhance) == 2


@pytest.mark.parametrize(("damaged", "ask"), [("cover", "small_drop_cover"), ("error", "small_error")])
def test_a_damaged_file_is_named(photographs, tmp_path, enhance, damaged, ask):
    views_of(photographs, tmp_path).files()
    (kept,) = tmp_path.iterdir()
    (kept / damaged / "view-1.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"view-1\.png"):
        getattr(views_of(photographs, tmp_path), ask)(1)
