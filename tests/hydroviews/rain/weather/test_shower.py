import numpy as np
import pytest
from synthetic import capture_in
from wet import lens

from hydroviews.dataset.build import build
from hydroviews.dataset.card.contact_sheet import write_sheets
from hydroviews.dataset.checks.verify import verify
from hydroviews.dataset.statistics import read_statistics
from hydroviews.rain.effect import fall
from hydroviews.rain.lens.severity import drops_harm
from hydroviews.rain.light import expand_highlights
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.registry import parse_pattern
from hydroviews.rain.severity import wanted_harm
from hydroviews.rain.weather.chain import seen_through
from hydroviews.rain.weather.severity import LOSS, SHARES
from hydroviews.rain.weather.shower import Shower
from hydroviews.scene.depth import depth_path, write_depth
from hydroviews.scene.images import luminance, to_linear

PATTERN = Pattern("shower", 1)
OWN = "hydroviews.rain.weather."  # effects by their full names are there before they are registered


@pytest.fixture(autouse=True)
def no_blender(monkeypatch):
    """On every lens is a square drop that shows the picture's first pixel."""

    def bake(pattern, camera, folder, frame=0):
        return lens(height=camera.height, width=camera.width).matte

    monkeypatch.setattr("hydroviews.rain.lens.raindrops.bake_matte", bake)


@pytest.fixture
def rain(yard):
    return Shower().place(Shower().draw(PATTERN, yard), PATTERN, yard)


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
            assert np.allclose(np.stack([own[c][20:, 30:] for c in "RGB"], -1), shown, atol=2e-3)
            assert luminance(to_linear(picture)).mean() < luminance(to_linear(clean)).mean()
        picture = part.composite(rain.parameters[name], picture, own)
    assert np.array_equal(picture, Shower().composite(rain.parameters, clean, layers))


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


def test_weather_is_built_verified_described_and_shown(tmp_path):
    scene = capture_in(tmp_path / "yard")
    depth = np.full((36, 48), 4.0)
    depth[:9] = np.inf
    for view in scene.views:
        write_depth(depth_path(view), depth)
    names = [f"{OWN}{name}-1" for name in ("haze:Haze", "dark:Dark", "night:Night", "shower:Shower")]
    folder = build(scene, tmp_path / "data", patterns=[parse_pattern(name) for name in names])
    assert verify(tmp_path / "data", every_view=True) == []
    table = read_statistics(folder / "statistics.csv").set_index("effect")
    dark, haze, shower = (table.loc[OWN + name] for name in ("dark.Dark", "haze.Haze", "shower.Shower"))
    assert np.isnan(dark["water_mean"])
    assert dark["brightness_change_mean"] < 0
    assert haze["mist_mean"] > 0
    assert shower["water_mean"] > 16 * 18 / (36 * 48) - 1e-4  # the drop, and the storm's drops
    assert shower["mist_mean"] > 0
    card = (folder / "README.md").read_text()
    for words in ("darker by", "lamps: ", "extinction of", "noise of", "mm/h"):
        assert words in card
    assert all(path.stat().st_size > 1000 for path in write_sheets(folder))
