"""Between drops that stay on the lens, enhanced pictures show what the photographs show; elsewhere nothing changes."""

import numpy as np
import pytest
from splats import photographed
from tiny_network import TINY

from baselines.training.images import read_images
from deraings.enhancement import views as enhanced_views
from deraings.enhancement.architecture.network import EnhancementNetwork
from deraings.enhancement.clear_pixels import DROPS, STREAKS, hidden_by_drops, lens_covers, with_clear_pixels
from deraings.enhancement.enhance import Enhanced
from deraings.enhancement.views import EnhancedViews
from deraings.enhancement.weights import Enhancer
from hydroviews.scene.images import read_image

HEIGHT, WIDTH = 36, 48


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def drop(row=10, column=20, radius=5):
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return np.hypot(rows - row, columns - column) < radius


def covers(rng, drops, streaks=0):
    """What a network sees of each view: its drops, some less surely, and some of the scene that looks alike."""
    found = []
    for own in drops:
        cover = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        cover[..., DROPS] = rng.integers(150, 256, (HEIGHT, WIDTH)) * own
        cover[rng.random((HEIGHT, WIDTH)) < 0.1] = 200, 200, 0
        cover[..., STREAKS] = streaks
        found.append(cover)
    return found


def test_drops_that_stay_are_where_all_views_have_them(rng):
    found = lens_covers(covers(rng, [drop()] * 12))
    assert found.stay
    assert len(found.means) == 12
    for mean in found.means:
        assert mean.shape == (HEIGHT, WIDTH)
        assert mean[drop()].min() > 0.5
        assert mean[~drop()].max() < 0.5
        assert mean[~drop()].mean() < 0.1


def test_a_drop_that_moves_over_is_followed(rng):
    early, late = lens_covers(covers(rng, [drop(column=12)] * 40 + [drop(column=36)] * 40)).means[::79]
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
    assert not lens_covers(seen(rng)).stay


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

    monkeypatch.setattr(enhanced_views, "predict", checked)
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
