from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array
from synthetic import capture_in

from hydroviews.dataset.build import build
from hydroviews.dataset.card.contact_sheet import write_sheets
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.statistics import read_statistics
from hydroviews.rain.compositing import WATER, LayerPlane
from hydroviews.rain.effect import fall
from hydroviews.rain.lens.optics.path_matte import PathMatte
from hydroviews.rain.lens.severity import drops_harm
from hydroviews.rain.light import expand_highlights
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.registry import parse_pattern
from hydroviews.rain.severity import wanted_harm
from hydroviews.rain.weather.chain import Chain, seen_through
from hydroviews.rain.weather.haze import Haze
from hydroviews.rain.weather.noise import NoisePattern
from hydroviews.rain.weather.severity import LOSS, SHARES
from hydroviews.rain.weather.shower import Shower
from hydroviews.scene.depth import depth_path, write_depth
from hydroviews.scene.images import luminance, to_linear, to_srgb, to_uint8

PATTERN = Pattern("shower", 1)
OWN = "hydroviews.rain.weather."  # effects by their full names are there before they are registered


def one_drop(pattern, camera, folder, frame=0) -> PathMatte:
    """A square drop that shows the picture's first pixel."""
    mask = np.zeros((camera.height, camera.width), np.float32)
    mask[20:26, 10:20] = 1
    pixels = np.flatnonzero(mask)
    paths = csr_array((np.ones(60, np.float32), np.zeros(60, int), np.arange(61)), shape=(60, mask.size))
    return PathMatte(mask, np.zeros_like(mask), pixels, paths, 0.0)


@pytest.fixture(autouse=True)
def no_blender(monkeypatch):
    monkeypatch.setattr("hydroviews.rain.lens.raindrops.bake_matte", one_drop)


@pytest.fixture
def rain(yard):
    return Shower().place(Shower().draw(PATTERN, yard), PATTERN, yard)


def test_planes_have_the_names_of_their_parts():
    names = {"haze.H", *(f"{part}.{key}" for part in ("storm", "lens") for key in WATER), "noise.NR"}
    assert names < set(Shower.planes)
    assert Shower.needs_optics
    assert Shower.needed == ("ambient", "haze", "storm", "lens", "noise")
    assert Shower.falling in Shower.planes


def test_each_part_falls_on_what_those_before_it_left(yard, rain, tmp_path):
    """By hand: the drop shows the dark, hazy, rainy scene, and what comes out is the composite."""
    view = yard.views[0]
    clean = view.image()
    layers = fall(rain.prepare(view.camera, tmp_path), clean, view)
    picture = clean
    for name, part in Shower.parts.items():
        own = {key: layers[f"{name}.{key}"] for key in part.planes}
        if name == "lens":
            shown = expand_highlights(to_linear(picture))[0, 0]
            found = [own[c][20:26, 10:20] for c in "RGB"]
            assert np.allclose(np.stack(found, -1), shown, atol=2e-3)
            assert luminance(to_linear(picture)).mean() < luminance(to_linear(clean)).mean()
        picture = part.composite(rain.parameters[name], picture, own)
    assert np.array_equal(picture, Shower().composite(rain.parameters, clean, layers))


def test_mist_and_haze_have_the_light_of_the_darkened_scene(yard, rain):
    stops = rain.parameters["ambient"]["stops"]
    assert stops > 0
    plain = np.array(yard.light.air)
    for name, key in (("haze", "airlight"), ("lens", "air_light")):
        light = np.array(rain.parameters[name][key]) / rain.parameters[name]["air"]
        assert (light < plain).all()
    dark = seen_through(
        Shower.parts["ambient"],
        Shower.parts["ambient"].place(Shower().draw(PATTERN, yard)["ambient"], PATTERN, yard),
        yard,
    )
    assert rain.parameters["haze"]["airlight"] == pytest.approx(
        np.array(dark.light.air) * rain.parameters["haze"]["air"], abs=1e-5
    )


@pytest.mark.parametrize("index", [0, 1, 2])
def test_parts_do_their_shares_of_the_harm(yard, index, tmp_path):
    pattern = Pattern("shower", index)
    drawn, wanted = Shower().draw(pattern, yard), wanted_harm(LOSS["shower"][pattern.grade], yard)
    assert Shower().draw(pattern, yard) == drawn
    seen, shares = yard, {}
    for name in ("ambient", "haze"):
        part = Shower.parts[name]
        seen = seen_through(part, part.place(drawn[name], pattern, seen), seen)
        shares[name] = np.mean([np.mean((s - c) ** 2) for s, c in zip(seen.samples, yard.samples, strict=True)])
    assert shares["ambient"] == pytest.approx(SHARES["ambient"] * wanted, rel=0.05)
    assert shares["haze"] == pytest.approx((SHARES["ambient"] + SHARES["haze"]) * wanted, rel=0.05)
    assert drops_harm(drawn["lens"].coverage, seen) <= 1.1 * SHARES["drops"] * wanted
    assert 0 < drawn["storm"].density <= 6
    assert sum(SHARES.values()) == pytest.approx(1)


def test_a_chain_of_parts_that_need_nothing_is_its_effects_one_by_one(yard, tmp_path):
    class Twice(Chain):
        parts = {"near": Haze(), "far": Haze()}  # noqa: RUF012

        def draw(self, pattern, statistics):
            return {name: Haze().draw(pattern, statistics) for name in self.parts}

    drawn = Twice().draw(PATTERN, yard)
    rain, view = Twice().place(drawn, PATTERN, yard), yard.views[1]
    clean = view.image()
    once = Haze().place(drawn["near"], PATTERN, yard)
    first = fall(once.prepare(view.camera, tmp_path), clean, view)
    hazy = Haze().composite(once.parameters, clean, first)
    layers = fall(rain.prepare(view.camera, tmp_path), clean, view)
    assert np.array_equal(layers["near.H"], first["H"])
    second = Haze().composite(rain.parameters["far"], hazy, {"H": layers["far.H"]})
    assert np.array_equal(Twice().composite(rain.parameters, clean, layers), second)
    assert Twice().describe(rain.parameters).startswith("near: extinction of ")
    assert Twice.planes["far.H"] == LayerPlane("cover by haze", "mist")


def test_weather_is_built_verified_described_and_shown(tmp_path):
    scene = capture_in(tmp_path / "yard")
    for view in scene.views:
        depth = np.full((36, 48), 4.0)
        depth[:9] = np.inf
        write_depth(depth_path(view), depth)
    names = [f"{OWN}{name}-1" for name in ("haze:Haze", "dark:Dark", "night:Night", "shower:Shower")]
    folder = build(scene, tmp_path / "data", patterns=[parse_pattern(name) for name in names])
    assert verify(tmp_path / "data", every_view=True) == []
    table = read_statistics(folder / "statistics.csv").set_index("effect")
    assert table.loc[OWN + "dark.Dark", "water_mean"] != table.loc[OWN + "dark.Dark", "water_mean"]  # it has none
    assert table.loc[OWN + "haze.Haze", "mist_mean"] > 0
    shower = table.loc[OWN + "shower.Shower"]
    assert shower["water_mean"] > 60 / (36 * 48) - 1e-4  # the drop, and the storm's drops
    assert shower["mist_mean"] > 0
    assert (table["brightness_change_mean"][OWN + "dark.Dark"]) < 0
    card = (folder / "README.md").read_text()
    for words in ("darker by", "lamps: ", "extinction of", "noise of", "mm/h"):
        assert words in card
    assert all(path.stat().st_size > 1000 for path in write_sheets(folder))


def test_noise_comes_last_and_only_on_the_picture(yard, rain, tmp_path):
    """The other layers are the same whatever the sensor."""
    quiet = Shower().draw(PATTERN, yard) | {"noise": NoisePattern(0.0, 0.0)}
    view = yard.views[0]
    clean = view.image()
    noisy, silent = (
        fall(r.prepare(view.camera, tmp_path), clean, view) for r in (rain, Shower().place(quiet, PATTERN, yard))
    )
    assert all(np.array_equal(noisy[key], silent[key]) for key in noisy)
    assert list(Shower.parts)[-1] == "noise"


def test_one_view_has_one_key_frame(yard):
    alone = replace(yard, views=yard.views[:1], samples=yard.samples[:1])
    assert Shower().draw(PATTERN, alone)["lens"].key_frames == 1


def test_a_black_scene(yard):
    samples = tuple(np.zeros_like(sample) for sample in yard.samples)
    black = replace(yard, samples=samples, detail=0.0, light=replace(yard.light, mean=(0.0,) * 3, air=(0.0,) * 3))
    rain = Shower().place(Shower().draw(PATTERN, black), PATTERN, black)
    view = yard.views[0]
    layers = fall(rain.prepare(view.camera, view.path.parent), samples[0], view)
    assert all(np.isfinite(plane).all() for plane in layers.values())
    assert to_uint8(Shower().composite(rain.parameters, samples[0], layers)).max() < 30
    assert to_srgb(np.zeros(3)).max() == 0
