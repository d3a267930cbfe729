from dataclasses import replace

import numpy as np
import pytest

from hydroviews.errors import InputError
from hydroviews.rain.lens.optics.mesh import water_mesh
from hydroviews.rain.lens.patterns.film import draw_film
from hydroviews.rain.lens.patterns.mist import window_mist
from hydroviews.rain.lens.patterns.runs import draw_rivulets
from hydroviews.rain.lens.patterns.water import water_at
from hydroviews.rain.lens.patterns.window import BY_GRADE, KINDS, WindowPattern, draw_window
from hydroviews.scene.cameras import Camera

EXTENT = (1.2, 1 / 1.2)  # sides of a picture of 3:2, about
EVEN = replace(draw_window(np.random.default_rng(0), 0), patches=0.0, film=0, rivulets=0, coverage=0.0, bead_aspect=1.0)


def of_kind(name: str) -> WindowPattern:
    """The first draw of a kind."""
    grade = next(i for i, kinds in enumerate(BY_GRADE) if name in kinds)
    drawn = (draw_window(np.random.default_rng(seed), grade) for seed in range(100))
    return next(pattern for pattern in drawn if pattern.kind == name)


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_has_its_ingredients(name):
    pattern, kind = of_kind(name), KINDS[name]
    assert kind.beads[0] <= pattern.droplets <= kind.beads[1]
    assert 800 <= pattern.droplets <= 4000
    assert kind.film[0] <= pattern.film <= kind.film[1]
    assert kind.runs[0] <= pattern.rivulets <= kind.runs[1]
    assert len(draw_film(pattern, EXTENT)) >= 50 * pattern.film
    assert len(water_at(pattern, EXTENT, 0.0).beads) > 0.5 * pattern.droplets


@pytest.mark.parametrize("seed", range(3))
def test_radii_of_beads_are_those_of_published_pictures(seed):
    drawn = draw_window(np.random.default_rng(seed), 1)
    pattern = replace(drawn, patches=0.0, film=0, rivulets=0, coverage=0.0, droplets=1500)
    radii = water_at(pattern, EXTENT, 0.0).beads.radii / EXTENT[0]
    assert len(radii) > 1400
    assert 0.0025 < np.median(radii) < 0.0033
    assert 0.008 < np.quantile(radii, 0.95) < 0.015


def test_beads_keep_apart():
    beads = water_at(replace(EVEN, droplets=800), EXTENT, 0.0).beads
    apart = np.linalg.norm(beads.places[:, None] - beads.places[None], axis=-1)
    near = (beads.radii[:, None] + beads.radii[None]) * 0.95  # aspects differ a little
    assert (apart < near)[~np.eye(len(beads), dtype=bool)].mean() < 1e-4


def test_larger_water_hides_beads_and_runs_wipe_them():
    pattern = replace(EVEN, coverage=0.03, rivulets=2, droplets=1500)
    water = water_at(pattern, EXTENT, 0.0)

    def nearest(places):
        return np.linalg.norm(water.beads.places[:, None] - places, axis=-1).min()

    disks = np.array([disk for drop in water.drops for disk in drop.outline.disks])
    assert len(disks) >= 10
    assert nearest(disks[:, :2]) > disks[:, 2].min()
    ways = np.concatenate([rivulet.way for rivulet in water.rivulets])
    assert nearest(ways) > 0.9 * min(rivulet.start_radius for rivulet in water.rivulets)


def test_meshes_of_beads_are_closed_and_as_high_as_spheres_caps():
    camera = Camera(120, 100, 100, 100, 60, 50, np.eye(4))
    water = water_at(replace(EVEN, droplets=40), EXTENT, 0.0)
    mesh = water_mesh(replace(water, droplets=np.zeros((0, 4))), EVEN.capillary_length, camera)
    assert len(mesh.caps) == len(mesh.bases)
    height = float(mesh.vertices[:, 2].max()) - 1
    expected = (water.beads.radii * np.tan(water.beads.angles / 2)).max() * np.sqrt(120 * 100) / 100
    assert height == pytest.approx(expected, rel=1e-3)


def test_mist_of_a_pane_is_uneven_and_wiped():
    pattern = replace(of_kind("fog"), mist=0.9, rivulets=3, coverage=0.02)
    wiped, whole = (window_mist(p, 240, 160, 0.5) for p in (pattern, replace(pattern, rivulets=0, coverage=0.0)))
    assert whole.max() > 0.6
    assert np.quantile(whole, 0.2) < 0.1
    assert np.all(wiped <= whole + 1e-6)
    sides = np.array([240, 160])
    rivulets = draw_rivulets(pattern, tuple(sides / np.sqrt(sides.prod())), 0.5)
    ways = np.concatenate([rivulet.way[5:-5:5] for rivulet in rivulets]) * np.sqrt(sides.prod())
    column, row = ways[np.all((ways >= 0) & (ways < sides), axis=1)].astype(int).T
    assert len(row) > 0
    assert np.all(wiped[row, column] < 0.45 * whole[row, column] + 1e-6)
    assert window_mist(replace(pattern, mist=0.0), 60, 40, 0.0).max() == 0


@pytest.mark.parametrize("wrong", [{"own_light": 1.2}, {"own_light": -0.1}, {"lens_renderer": "traced"}])
def test_what_no_pane_can_be_is_refused(wrong):
    with pytest.raises(InputError):
        replace(EVEN, **wrong)
