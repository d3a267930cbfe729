"""Predictions for each photograph are kept on disk; between drops, pictures show the photographs."""

from dataclasses import replace

import numpy as np
import pytest
from splats import photographed
from tiny_network import TINY

from baselines.training.images import TrainingImages, read_images
from deraings.enhancement import views as module
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.clear_pixels import DROPS, STREAKS, hidden_by_drops, lens_covers, with_clear_pixels
from deraings.enhancement.enhance import Enhanced
from deraings.enhancement.views import COVER_SIDE, EnhancedViews
from deraings.enhancement.weights import Enhancer
from hydroviews.errors import InputError
from hydroviews.scene.images import read_image

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
    assert not views.wet
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


HEIGHT, WIDTH = 36, 48


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def drop(row=10, column=20, radius=5):
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.hypot(rows - row, columns - column) < radius


def covers(rng, drops, streaks=0):
    """Predictions for each view: its drops, some less surely, and parts of the scene that look alike."""
    found = []
    for own in drops:
        cover = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        cover[..., DROPS] = rng.integers(150, 256, (HEIGHT, WIDTH)) * own
        cover[rng.random((HEIGHT, WIDTH)) < 0.1] = 200, 200, 0
        cover[..., STREAKS] = streaks
        found.append(cover)
    return found


def test_drops_that_stay_are_where_all_views_have_them(rng):
    found = lens_covers(covers(rng, [drop()] * 12), [False] * 12)
    assert found.wet
    assert len(found.means) == 12
    for mean in found.means:
        assert mean.shape == (HEIGHT, WIDTH)
        assert mean[drop()].min() > 0.5
        assert mean[~drop()].max() < 0.5
        assert mean[~drop()].mean() < 0.1


def test_a_drop_that_moves_over_is_followed(rng):
    early, late = lens_covers(covers(rng, [drop(column=12)] * 40 + [drop(column=36)] * 40), [False] * 80).means[::79]
    assert early[drop(column=12)].mean() > 0.7 > 0.1 > early[drop(column=36)].mean()
    assert late[drop(column=36)].mean() > 0.7 > 0.1 > late[drop(column=12)].mean()


@pytest.mark.parametrize(
    "seen",
    [
        lambda rng: covers(rng, [drop(rng.integers(HEIGHT), rng.integers(WIDTH)) for _ in range(30)]),
        lambda rng: covers(rng, [np.zeros((HEIGHT, WIDTH), bool)] * 12),
        lambda rng: covers(rng, [drop()] * 12, streaks=20),
        lambda rng: covers(rng, [drop()]),
        lambda rng: [cover[: HEIGHT - 6 * (i % 2) * 4] for i, cover in enumerate(covers(rng, [drop()] * 2))],
    ],
    ids=["renewed", "dry", "streaks", "one view", "one view a lens"],
)
def test_nothing_is_known_to_stay(rng, seen):
    found = seen(rng)
    assert not lens_covers(found, [False] * len(found)).wet


def test_new_drops_are_where_their_own_view_has_them(rng):
    seen = covers(rng, [drop(rng.integers(HEIGHT), rng.integers(WIDTH)) for _ in range(30)])
    found = lens_covers(seen, [True] * 30)
    assert found.wet
    for mean, own in zip(found.means, seen, strict=True):
        np.testing.assert_array_equal(mean, own[..., DROPS] / np.float32(255))


def test_what_is_mostly_covered_is_wholly_hidden_and_what_is_hardly_covered_hardly():
    mean = np.linspace(0, 1, 101, dtype=np.float32)[None]
    hidden = hidden_by_drops(mean)
    assert (np.diff(hidden) >= 0).all()
    assert (hidden >= mean).all()
    np.testing.assert_array_equal(hidden[mean <= 0.2], mean[mean <= 0.2])
    np.testing.assert_array_equal(hidden[mean >= 0.5], 1)


def test_clear_pixels_keep_the_detail_and_take_the_smooth_light(rng):
    photograph = rng.uniform(0.3, 0.7, (HEIGHT, WIDTH, 3)).astype(np.float32)
    enhanced = np.full_like(photograph, 0.4)  # without detail, and darker by 0.1
    cover = drop().astype(np.float32)
    found = with_clear_pixels(enhanced, photograph, cover)
    assert found.dtype == np.float32
    assert np.array_equal(found[drop()], enhanced[drop()])
    off = found[~drop()] - (photograph[~drop()] - 0.1)
    assert abs(off.mean()) < 0.01
    assert off.std() < 0.35 * photograph.std()


@pytest.mark.parametrize("cover", [0.0, 1.0])
def test_a_lens_that_is_clear_or_covered_all_over(rng, cover):
    photograph, enhanced = rng.random((2, HEIGHT, WIDTH, 3), np.float32)
    found = with_clear_pixels(enhanced, photograph, np.full((HEIGHT, WIDTH), cover, np.float32))
    assert np.isfinite(found).all()
    assert (np.abs(found - enhanced).max() < 1e-6) == (cover == 1)


def test_pictures_of_a_capture_are_cleared_once(rng, tmp_path, monkeypatch):
    scene = photographed(tmp_path / "scene")
    images, names = read_images(scene.train_views), [view.name for view in scene.train_views]
    seen = iter(covers(rng, [drop()] * len(names)))
    checks = np.float32(0.1) * (np.indices((HEIGHT, WIDTH)).sum(0) % 2 * 2 - 1).astype(np.float32)[..., None]

    def checked(image, *_):
        return Enhanced(np.clip(image + checks, 0, 1), next(seen).astype(np.float32) / 255, None)

    monkeypatch.setattr(module, "predict", checked)
    enhancer = Enhancer(EnhancementNetwork(TINY).eval(), {}, "tiny")
    views = EnhancedViews(images, names, enhancer, tmp_path / "kept")
    cleared, network = views.files(clear=True), views.files()
    assert cleared != network
    for index, (path, plain) in enumerate(zip(cleared, network, strict=True)):
        picture, enhanced, photograph = read_image(path), read_image(plain), images.pixels(index) / 255
        assert np.abs(picture - enhanced)[drop(radius=3)].max() < 0.01
        clear = ~drop(radius=8)
        assert np.abs(picture - photograph)[clear].mean() < 0.5 * np.abs(enhanced - photograph)[clear].mean()
    times = [path.stat().st_mtime_ns for path in cleared]
    again = EnhancedViews(images, names, enhancer, tmp_path / "kept").files(clear=True)
    assert times == [path.stat().st_mtime_ns for path in again]
    assert np.array_equal(views.training_images(clear=True).pixels(0), (read_image(cleared[0]) * 255).round())
    assert views.training_images(clear=True) is views.training_images(clear=True)  # large: several ask for them
