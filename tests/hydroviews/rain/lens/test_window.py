import json
from dataclasses import replace

import numpy as np
import pytest
from kept_blender import bakes
from synthetic import capture_in

from hydroviews.dataset.build import build
from hydroviews.dataset.checks.verify import verify
from hydroviews.rain.effect import fall
from hydroviews.rain.lens.optics import bake as lens_bake
from hydroviews.rain.lens.optics.path_matte import PathMatte, dry
from hydroviews.rain.lens.patterns.window import BY_GRADE, draw_window
from hydroviews.rain.lens.window import Window, WindowEffect, behind_mist
from hydroviews.rain.lens.window_severity import LOSS, WindowHarm, grade_window
from hydroviews.rain.patterns import GRADES, Pattern
from hydroviews.rain.registry import parse_pattern
from hydroviews.rain.scene_statistics import Light, SceneStatistics
from hydroviews.rain.severity import wanted_harm
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import to_linear, to_srgb
from hydroviews.scene.scenes import View, no_points

CAMERA = Camera(60, 45, 48, 48, 30, 22.5, np.eye(4))
PANE = replace(
    draw_window(np.random.default_rng(1), 1), droplets=60, droplet_median=0.02, coverage=0.02, radius_median=0.04,
    rivulets=0, film=0, patches=0.0, mist=0.6, tilt=0.0, own_light=1.0, key_frames=1,
)  # fmt: skip


def statistics(detail: float = 0.002, count: int = 8) -> SceneStatistics:
    rng = np.random.default_rng(0)
    samples = tuple(rng.uniform(0.2, 0.7, (30, 40, 3)).astype(np.float32) for _ in range(2))
    views = tuple(View(f"view-{i}", CAMERA, None) for i in range(count))
    light = Light((0.2, 0.2, 0.2), (0.5, 0.55, 0.6))
    return SceneStatistics("none", 0, views, no_points(), 1 / count, samples, detail, light)


def picture(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, 1, (45, 60, 3)).astype(np.float32)


@pytest.fixture
def half_wet(monkeypatch):
    """The left half of every pane is water that is bright below; its paths end where they begin."""
    none = dry(45, 60, window=True)
    mask, sky = np.zeros_like(none.mask), np.zeros_like(none.mask)
    mask[:, :30], sky[22:, :30] = 0.9, 0.9
    matte = PathMatte(mask, mask, none.pixels, none.paths, 0.0, sky)
    monkeypatch.setattr("hydroviews.rain.lens.raindrops.bake_matte", lambda *_: matte)


def test_grades_have_kinds_of_their_own_and_the_same_seed_the_same_pattern():
    for index, grade in enumerate(GRADES):
        drawn, again = (WindowEffect().draw(Pattern("window", index), statistics()) for _ in range(2))
        assert drawn == again
        assert drawn.kind in BY_GRADE[index]
        assert Pattern("window", index).grade == grade


def test_harm_grows_with_grades_beads_and_mist():
    scene, harms = statistics(), []
    for index in range(3):
        drawn = WindowEffect().draw(Pattern("window", index), scene)
        harm = WindowHarm(drawn, scene)
        harms.append(harm(1.0, drawn.mist))
        assert harms[-1] < harm(1.0, drawn.mist + 0.2)
        assert harms[-1] < harm(1.5, drawn.mist) or drawn.mist > 0
    assert harms == sorted(harms)
    assert harms[1] == pytest.approx(wanted_harm(LOSS["medium"], scene), rel=0.1)
    assert harms[2] >= 0.9 * wanted_harm(LOSS["heavy"], scene)


def test_film_that_harms_too_much_has_fewer_bands():
    scene, film = statistics(), replace(draw_window(np.random.default_rng(0), 0), film=6)
    dear = replace(scene, drops_cost=100.0)
    assert grade_window(film, "light", dear).film < grade_window(film, "light", scene).film <= 6
    assert grade_window(film, "heavy", dear).film == 6  # heavy panes keep all of theirs


@pytest.mark.usefixtures("half_wet")
def test_the_rainy_view_follows_from_layers_and_parameters_alone(tmp_path):
    scene, clean = statistics(), picture(0)
    rain = Window(replace(PANE, mist_blur=0.0), scene)
    layers = fall(rain.prepare(CAMERA, tmp_path), clean, scene.views[0])
    assert set(layers) == set("MVRGB")
    rainy = WindowEffect().composite(rain.parameters, clean, layers)
    passing = ((1 - layers["M"]) * (1 - layers["V"]))[..., None]
    expected = to_srgb(to_linear(clean) * passing + np.stack([layers[c] for c in "RGB"], -1))
    assert np.allclose(rainy, expected, atol=1e-6)


@pytest.mark.usefixtures("half_wet")
def test_own_light_does_not_depend_on_the_scene(tmp_path):
    scene = statistics()

    def panes(share):
        rain = Window(replace(PANE, own_light=share), scene).prepare(CAMERA, tmp_path)
        return [rain.layers(clean, scene.views[0]) for clean in (picture(0), picture(1) ** 2)]

    one, other = panes(1.0)
    first, second = panes(0.5)
    assert all(np.array_equal(one[name], other[name]) for name in one)
    assert one["G"][40, :20].mean() > 3 * one["G"][5, :20].mean()
    assert not np.array_equal(first["R"], second["R"])


def test_the_scene_is_blurred_where_mist_is_thick():
    light, veil = picture(0), np.zeros((45, 60), np.float32)
    veil[:, 30:] = 1.0
    seen = behind_mist(light, veil, 0.05)
    assert np.array_equal(seen[:, :30], light[:, :30])
    assert seen[:, 30:].std() < 0.5 * light[:, 30:].std()
    assert behind_mist(light, np.zeros_like(veil), 0.05) is light


@bakes
def test_baked_beads_are_dark_above_and_bright_below(tmp_path):
    pattern = replace(PANE, up=0.0, edge=0.08, bead_aspect=1.0, mist=0.0, focus_blur=0.0)
    matte = lens_bake.bake_matte(pattern, CAMERA, tmp_path)
    assert matte.sky is not None
    assert 0.05 < matte.mask.mean() < 0.9
    assert np.all(matte.sky <= matte.mask + 1e-5)
    beads, side = lens_bake.water_of(pattern, CAMERA, 0).beads, np.sqrt(60 * 45)
    places, radii = beads.places * side, beads.radii * side
    inside = (radii > 2) & np.all((places > 4) & (places < (56, 41)), axis=1)
    (x, y), away = places[inside].T, 0.7 * radii[inside]
    above, below = (matte.sky[rows.astype(int), x.astype(int)] for rows in (y - away, y + away))
    assert len(above) >= 3
    assert below.mean() > above.mean() + 0.2


@bakes
def test_renewed_beads_keep_their_own_light(tmp_path, monkeypatch):
    monkeypatch.setattr("hydroviews.rain.lens.renewed.LENSES", 1)
    scene = statistics(count=3)
    ready = Window(replace(PANE, renewed=0.5, mist=0.0), scene).prepare(CAMERA, tmp_path)
    first, second = (ready.layers(picture(0), view) for view in scene.views[:2])
    assert not np.array_equal(first["M"], second["M"])
    wet = first["G"][first["M"] > 0.9]
    assert wet.size > 0
    assert wet.std() > 0.05  # bright and dark parts
    dark, bright = to_linear(np.array([PANE.dark, PANE.bright], np.float32))
    assert (1 - PANE.uneven) * dark * 0.85 <= wet.min() <= wet.max() <= bright * 1.001


@bakes
def test_a_built_pane_verifies(tmp_path):
    scene = capture_in(tmp_path / "capture" / "yard")
    folder = build(scene, tmp_path / "data", patterns=[parse_pattern("window-2")], long_side=40)
    assert verify(tmp_path / "data") == []
    parameters = json.loads((folder / "window-2" / "pattern.json").read_text())["parameters"]
    assert parameters["kind"] in BY_GRADE[2]
    assert parameters["mist_blur"] > 0
