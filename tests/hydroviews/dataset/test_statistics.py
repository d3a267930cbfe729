from pathlib import Path

import numpy as np
import pytest

from hydroviews import metrics
from hydroviews.dataset.statistics import measure_view, read_statistics, write_statistics, write_summary
from hydroviews.errors import InputError
from hydroviews.files.atomic import write_bytes, write_json
from hydroviews.rain.layers import read_layers, write_layers
from hydroviews.rain.streaks.measures import seed_density, streak_angle
from hydroviews.rain.streaks.recipe import StreakPattern, composite, streak_layer
from hydroviews.scene.images import read_image, to_linear, write_png

STREAKS = StreakPattern(n=200, length=30, angle=70.0, width=5)
NAMES = ["000", "001", "1e3"]  # of views: they look like numbers, as photographs' names often do


def half(plane: np.ndarray) -> np.ndarray:
    return plane.astype(np.float16).astype(np.float32)


@pytest.fixture
def built(tmp_path) -> Path:
    """A scene folder with three views in streaks and in drops, laid out as a build does."""
    folder, rng = tmp_path / "yard", np.random.default_rng(0)
    covered = np.zeros((60, 80), np.float32)  # a corner, by water with its own light
    covered[:10, :20] = 1
    for name in NAMES:
        write_png(folder / "clean" / f"{name}.png", rng.random((60, 80, 3)).astype(np.float32))
        clean = read_image(folder / "clean" / f"{name}.png")
        streaks = half(streak_layer(STREAKS, 80, 60, rng))
        drops = {"M": covered, "V": np.full_like(covered, 0.25)}
        drops |= {channel: half(0.2 * rng.random(covered.shape)) for channel in "RGB"}
        for pattern, rainy, layers in (
            ("streak-1", composite(clean, streaks, 0.8), {"S": streaks}),
            ("raindrop-0", clean * (1 - covered)[..., None], drops),
        ):
            write_layers(folder / pattern / "layers" / f"{name}.exr", layers)
            write_png(folder / pattern / "images" / f"{name}.png", rainy)
    for effect, index, grade, parameters in (
        ("streak", 1, "medium", vars(STREAKS) | {"added later": 1}),
        ("raindrop", 0, "light", {}),
    ):
        facts = {"effect": effect, "index": index, "grade": grade, "parameters": parameters}
        write_json(folder / f"{effect}-{index}" / "pattern.json", facts)
    return folder


def test_a_row_a_view_says_what_the_files_say(built):
    table = read_statistics(write_statistics(built, "streak-1")).set_index("view")
    assert list(table.index) == NAMES
    clean, rainy = (read_image(built / part / "001.png") for part in ("clean", "streak-1/images"))
    row = table.loc["001"]
    assert row.psnr == pytest.approx(metrics.psnr(rainy, clean), abs=1e-4)
    assert row.brightness_change == pytest.approx(float((rainy - clean).mean()), abs=1e-5)
    gained = np.maximum(to_linear(rainy) - to_linear(clean), 0)
    assert row.added_light == pytest.approx(float(gained.mean()), abs=1e-5)
    layer = read_layers(built / "streak-1" / "layers" / "001.exr")["S"]
    assert row.streaks == pytest.approx(float(layer.mean()), abs=1e-5)
    assert table[["water", "mist"]].isna().all(axis=None)
    drops = read_statistics(write_statistics(built, "raindrop-0"))
    assert np.allclose(drops.water, 200 / 4800, atol=1e-5)
    assert np.allclose(drops.mist, 0.25)
    assert (drops.brightness_change < 0).all()
    assert drops[["streaks", "angle", "seed_density"]].isna().all(axis=None)


def test_the_scene_has_a_row_a_variant(built):
    views = read_statistics(write_statistics(built, "streak-1"))
    write_statistics(built, "raindrop-0")
    write_summary(built)
    table = read_statistics(built / "statistics.csv").set_index("pattern")
    assert list(table.index) == ["raindrop-0", "streak-1"]
    assert list(table.grade) == ["light", "medium"]
    row = table.loc["streak-1"]
    assert row.views == 3
    assert (row.psnr_min, row.psnr_max) == (views.psnr.min(), views.psnr.max())
    assert row.psnr_mean == pytest.approx(views.psnr.mean(), abs=1e-5)


def test_a_missing_layer_and_another_size_are_told(built):
    (built / "streak-1" / "layers" / "001.exr").unlink()
    with pytest.raises(InputError, match=r"001\.exr: no such layer"):
        write_statistics(built, "streak-1")
    write_png(built / "clean" / "000.png", np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(InputError, match="another size than its clean view"):
        write_statistics(built, "raindrop-0")


@pytest.mark.parametrize("length", [0, 10, 70, 200, -1])
def test_a_table_that_is_none_or_is_cut_short_is_told(built, length):
    path = write_statistics(built, "streak-1")
    content = path.read_bytes()
    for damaged in (content[:length], b"a,b\n1,2\n", b"view,psnr\n000,1\n", b"\xff\xfe"):
        write_bytes(path, damaged)
        with pytest.raises(InputError, match=r"not a table of statistics|cut short"):
            read_statistics(path)


def test_a_dry_view_has_an_infinite_psnr_and_neither_angle_nor_density():
    picture, facts = np.full((20, 20, 3), 7, np.uint8), {"effect": "streak", "parameters": vars(STREAKS)}
    dry = measure_view("a", picture, picture, {"S": np.zeros((20, 20), np.float32)}, facts)
    assert (dry.psnr, dry.angle, dry.seed_density) == (float("inf"), None, None)
    assert seed_density(np.zeros((2, 3), np.float32), STREAKS) is None


@pytest.mark.parametrize("size", [(320, 240), (400, 300), (800, 533), (301, 533)], ids=str)
@pytest.mark.parametrize("theta", [40, 67, 90, 120])
def test_measured_angle_is_theta(size, theta):
    for length, width, n in ((20, 3, 100), (20, 7, 300), (40, 3, 300), (40, 7, 100)):
        pattern = StreakPattern(n, length, float(theta), width)
        measured = streak_angle(half(streak_layer(pattern, *size, np.random.default_rng(1))))
        assert measured is not None
        assert abs((measured - theta + 90) % 180 - 90) < 3, (pattern, measured)


@pytest.mark.parametrize("n", [100, 300])
def test_measured_density_is_what_was_asked_for(n):
    measured = []
    for seed in range(8):
        pattern = StreakPattern(n, (20, 40)[seed % 2], (40.0, 90.0, 120.0)[seed % 3], (3, 7)[seed // 2 % 2])
        layer = half(streak_layer(pattern, 400, 300, np.random.default_rng(seed)))
        measured.append(seed_density(layer, pattern))
    assert np.mean(measured) == pytest.approx(n / 25600, rel=0.03)
    assert np.abs(np.array(measured) * 25600 / n - 1).max() < 0.15
