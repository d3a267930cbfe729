import json
from dataclasses import asdict, replace
from importlib.util import find_spec

import numpy as np
import pytest

from hydroviews.blender.drop_shapes import LONGEST, Drop, base, cap
from hydroviews.blender.process import run_blender
from hydroviews.cameras import Camera
from hydroviews.errors import InputError
from hydroviews.images import to_srgb
from hydroviews.rain import raindrops
from hydroviews.rain.path_matte import PathMatte, assemble, defocus
from hydroviews.rain.raindrops import RaindropPattern, bake_matte, draw_drops, draw_pattern, trace_drops

PATTERN = RaindropPattern(0.2, 0.06, 0.4, 20, 30.0, 55.0, 0.8, 0.0, 7)
NO_DROPS = replace(PATTERN, coverage=0.0, droplets=0)

needs_bpy = pytest.mark.skipif(
    find_spec("bpy") is None, reason="bpy is not installed: pip install 'hydroviews[blender]'"
)


def camera(width: int, height: int) -> Camera:
    return Camera(width, height, 0.8 * width, 0.8 * width, width / 2, height / 2, np.eye(4))


def paths_from(places, throughput=1.0, shape=(5, 7), disk=0.0) -> PathMatte:
    """One path for every pixel of a lens that is all under water."""
    pixels = np.arange(shape[0] * shape[1])
    return assemble(np.ones(shape), pixels, np.asarray(places, float), np.full(len(pixels), throughput), disk)


def pixel_centres(shape=(5, 7)):
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] + 0.5
    return np.stack([x.ravel(), y.ravel()], -1)


@pytest.fixture
def picture(rng):
    return rng.random((5, 7, 3)).astype(np.float32)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_the_same_generator_draws_the_same_pattern_and_it_goes_through_json():
    first, second = (draw_pattern(np.random.default_rng(4)) for _ in range(2))
    assert first == second
    assert RaindropPattern(**json.loads(json.dumps(asdict(first)))) == first
    assert draw_pattern(np.random.default_rng(5)) != first


def test_straight_paths_show_the_picture_itself(picture):
    matte = paths_from(pixel_centres())
    np.testing.assert_allclose(matte.apply(picture), picture, atol=1e-6)
    assert matte.mask.min() == 1


def test_paths_between_pixels_are_bilinear(picture):
    shifted = paths_from(pixel_centres() + np.array([0.25, 0])).apply(picture)
    np.testing.assert_allclose(shifted[:, :-1], 0.75 * picture[:, :-1] + 0.25 * picture[:, 1:], atol=1e-6)


@pytest.mark.parametrize(("offset", "flip"), [([7, 0], 1), ([-7, 0], 1), ([0, 5], 0), ([0, -5], 0)])
def test_the_picture_is_mirrored_beyond_its_borders(picture, offset, flip):
    np.testing.assert_allclose(
        paths_from(pixel_centres() + offset).apply(picture), np.flip(picture, axis=flip), atol=1e-6
    )


def test_two_periods_away_is_the_picture_again(picture):
    np.testing.assert_allclose(paths_from(pixel_centres() + np.array([28, -10])).apply(picture), picture, atol=1e-6)


def test_light_that_no_path_accounts_for_is_as_bright_as_the_view(picture):
    drops = paths_from(pixel_centres(), throughput=0.25).apply(picture)
    np.testing.assert_allclose(drops, 0.25 * picture + 0.75 * picture.mean(axis=(0, 1)), atol=1e-6)


def test_a_grey_picture_stays_grey_behind_defocused_drops(rng):
    pixels = rng.integers(0, 35, 60)
    throughput = np.full(60, 0.1)
    cover = np.bincount(pixels, throughput, minlength=35).reshape(5, 7) * 1.3
    matte = assemble(np.minimum(cover, 1), pixels, rng.uniform(-20, 20, (60, 2)), throughput, disk=2.6)
    grey = np.full((5, 7, 3), 0.4, np.float32)
    np.testing.assert_allclose((1 - matte.mask[..., None]) * grey + matte.apply(grey), grey, atol=1e-6)


def test_defocus_is_a_disk_of_the_given_diameter():
    point = np.zeros((41, 41), np.float32)
    point[20, 20] = 1
    spread = defocus(point, 11.0)
    y, x = np.mgrid[-20:21, -20:21]
    assert spread.sum() == pytest.approx(1, abs=1e-5)
    assert np.all(spread[np.hypot(x, y) > 6.3] == 0)
    np.testing.assert_allclose(spread[np.hypot(x, y) < 4.7], 1 / (np.pi * 5.5**2), rtol=0.02)
    assert defocus(point, 0.9) is point


def test_a_picture_of_another_size_is_refused(picture):
    with pytest.raises(ValueError, match="found"):
        paths_from(pixel_centres()).apply(picture[:4])


def test_a_matte_comes_back_from_its_file(picture, tmp_path):
    matte = paths_from(pixel_centres() + 0.3, 0.7, disk=2.0)
    matte.save(tmp_path / "matte.npz", "a key")
    loaded, key = PathMatte.load(tmp_path / "matte.npz")
    assert key == "a key"
    assert np.array_equal(loaded.apply(picture), matte.apply(picture))
    assert np.array_equal(loaded.mask, matte.mask)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut short", b"not an archive"])
def test_a_damaged_matte_is_named(tmp_path, content):
    (tmp_path / "matte.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"matte\.npz"):
        PathMatte.load(tmp_path / "matte.npz")


@pytest.mark.parametrize("size", [(320, 240), (90, 160), (8, 6), (1, 1)])
def test_drops_lie_apart_and_cover_what_was_asked(size):
    lens = camera(*size)
    pattern = replace(PATTERN, coverage=0.15, radius_median=0.025, droplets=100)
    drops = draw_drops(pattern, lens)
    assert drops == draw_drops(pattern, lens)
    place = np.array([[drop.x, drop.y] for drop in drops])
    radius = np.array([drop.radius * np.sqrt(drop.stretch) for drop in drops])
    apart = np.linalg.norm(place[:, None] - place, axis=-1) + np.diag(np.full(len(drops), np.inf))
    assert np.all(apart >= radius[:, None] + radius)
    width, height = (s / f for s, f in zip(size, (lens.fx, lens.fy), strict=True))
    area = sum(np.pi * drop.radius**2 * drop.stretch for drop in drops)
    assert area / (width * height * 1.1**2) == pytest.approx(0.15, abs=0.04)


def test_a_lens_without_drops_needs_no_blender(tmp_path, monkeypatch):
    monkeypatch.setattr(raindrops, "run_blender", pytest.fail)
    matte = bake_matte(NO_DROPS, camera(6, 4), tmp_path)
    assert matte.mask.shape == (4, 6)
    assert not matte.mask.any()
    assert not matte.apply(np.ones((4, 6, 3), np.float32)).any()


@pytest.mark.parametrize("stretch", [1.0, LONGEST])
def test_a_drop_is_a_spherical_cap_with_its_contact_angle(stretch):
    angle, radius = np.radians(50), 0.1
    drop = Drop(0.2, -0.1, radius, angle, stretch, 0.0, ())
    top = cap(drop).vertices
    height = (1 - np.cos(angle)) / np.sin(angle) * radius
    assert top[:, 2].max() - 1 == pytest.approx(height, rel=0.01)
    assert top[:, 2].min() == pytest.approx(1)
    assert np.ptp(base(drop).vertices[:, 1]) == pytest.approx(2 * radius * stretch, rel=0.01)
    assert np.all(base(drop).vertices[:, 2] == 1)


@pytest.mark.blender
@needs_bpy
def test_the_matte_agrees_with_full_path_tracing(tmp_path):
    lens = camera(80, 60)
    y, x = np.mgrid[0:60, 0:80] / 80
    waves = [0.5 + 0.45 * np.sin(a * x + b * y + c) for a, b, c in ((9, 4, 0), (3, 11, 1), (14, -8, 2))]
    picture = np.stack(waves, -1).astype(np.float32)
    traced = trace_drops(PATTERN, lens, picture, 256, tmp_path)
    matte = bake_matte(PATTERN, lens, tmp_path)
    inside = traced[..., 3] > 0.5
    assert 0.1 < inside.mean() < 0.3
    assert np.abs(matte.mask - traced[..., 3]).mean() < 0.005
    light, alpha = traced[..., :3], traced[..., 3:]
    expected = to_srgb((1 - alpha) * picture + light)
    found = to_srgb((1 - matte.mask[..., None]) * picture + matte.apply(picture))
    psnr = -10 * np.log10(((expected - found)[inside] ** 2).mean())
    assert psnr > 31, psnr


@pytest.mark.blender
@needs_bpy
def test_nothing_is_traced_without_drops(tmp_path):
    traced = trace_drops(NO_DROPS, camera(8, 6), np.ones((6, 8, 3), np.float32), 1, tmp_path)
    assert traced.shape == (6, 8, 4)
    assert not traced.any()


@pytest.mark.blender
@needs_bpy
def test_a_bake_is_the_same_in_two_processes_and_kept(tmp_path, monkeypatch):
    lens = camera(33, 24)
    first = bake_matte(replace(PATTERN, focus_blur=0.05), lens, tmp_path / "a")
    second = bake_matte(replace(PATTERN, focus_blur=0.05), lens, tmp_path / "b")
    assert (tmp_path / "a" / "matte.npz").read_bytes() == (tmp_path / "b" / "matte.npz").read_bytes()
    monkeypatch.setattr(raindrops, "run_blender", pytest.fail)
    kept = bake_matte(replace(PATTERN, focus_blur=0.05), lens, tmp_path / "a")
    for matte in (second, kept):
        assert np.array_equal(matte.mask, first.mask)
        assert (matte.paths != first.paths).nnz == 0
    assert first.mask.min() >= 0
    assert first.mask.max() <= 1


@pytest.mark.blender
@needs_bpy
def test_one_drop_sits_where_it_should_and_turns_the_world_upside_down(tmp_path):
    # Pixels that are not square and a principal point off the middle.
    lens = Camera(60, 40, 40.0, 50.0, 20.0, 25.0, np.eye(4))
    drop = Drop(0.25, -0.1, 0.2, np.radians(45), 1.0, 0.0, ())
    request = {"drops": [asdict(drop)], "camera": {**asdict(lens), "world_to_camera": np.eye(4).tolist()}}
    output = tmp_path / "paths.npz"
    run_blender("bake_drops", {**request, "paths": 4, "output": str(output)}, tmp_path / "log", "one drop")
    paths = dict(np.load(output))
    y, x = np.mgrid[0:40, 0:60] + 0.5
    centre = [(paths["cover"] * axis).sum() / paths["cover"].sum() for axis in (x, y)]
    np.testing.assert_allclose(centre, [40 * 0.25 + 20, 50 * -0.1 + 25], atol=0.1)
    assert paths["cover"].sum() == pytest.approx(np.pi * 0.2**2 * 40 * 50, rel=0.02)
    matte = assemble(*(paths[name] for name in ("cover", "pixel", "place", "throughput")), 0.0)
    bright_above = np.repeat((y < 20).astype(np.float32)[..., None], 3, axis=2)
    seen = matte.apply(bright_above)[..., 0]
    assert seen[16:18, 30].mean() < 0.2  # the upper part of the drop shows what is below
    assert seen[22:24, 30].mean() > 0.8
