"""What every effect promises: a view follows from seed and parameters, whatever the scene; nothing is out of range."""

from dataclasses import replace

import numpy as np
import pytest
from rained import rained

from hydroviews.rain.patterns import Pattern
from hydroviews.rain.registry import find_effect, registered_effects
from hydroviews.rain.scene_statistics import Light

BAKED = {"raindrop", "raindrop-renewed", "raindrop-sharp", "window", "shower"}  # by Blender: tests of lenses have them
EFFECTS = sorted(registered_effects().keys() - BAKED)


def in_medium(name, statistics, clean=None):
    """The first view in medium rain, its layers, and the view as it was."""
    effect, pattern = find_effect(name), Pattern(name, 1)
    clean = statistics.views[0].image() if clean is None else clean
    return *rained(effect, effect.draw(pattern, statistics), pattern, statistics, clean=clean)[:2], clean


def assert_sound(rainy, layers, clean):
    assert rainy.shape == clean.shape
    assert 0 <= rainy.min() <= rainy.max() <= 1
    assert all(plane.shape == clean.shape[:2] and np.isfinite(plane).all() for plane in layers.values())


@pytest.mark.parametrize("name", EFFECTS)
def test_it_changes_the_view_by_the_planes_it_names(name, yard):
    rainy, layers, clean = in_medium(name, yard)
    assert_sound(rainy, layers, clean)
    assert layers.keys() == find_effect(name).planes.keys()
    assert np.abs(rainy - clean).max() > 0.01


@pytest.mark.parametrize("name", EFFECTS)
def test_the_seed_decides(name, yard):
    first, again, other = (in_medium(name, replace(yard, seed=seed))[0] for seed in (0, 0, 1))
    assert first.tobytes() == again.tobytes() != other.tobytes()


@pytest.mark.parametrize("name", EFFECTS)
def test_one_view_is_enough(name, yard):
    assert_sound(*in_medium(name, replace(yard, views=yard.views[:1], samples=yard.samples[:1])))


@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize("size", [(1, 1), (64, 1), (1, 64), (17, 15)])
def test_any_size_of_picture(name, size, yard):
    view = replace(yard.views[0], camera=yard.views[0].camera.resized(*size))
    clean = np.full((*size[::-1], 3), 0.5, np.float32)
    assert_sound(*in_medium(name, replace(yard, views=(view, *yard.views[1:])), clean))


@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize("value", [0.0, 1.0])
def test_black_and_saturated_scenes(name, value, yard):
    """There is no detail: no harm is wanted, and nothing may divide by it."""
    samples = tuple(np.full_like(sample, value) for sample in yard.samples)
    flat = replace(yard, samples=samples, detail=0.0, light=Light((value,) * 3, (value,) * 3))
    clean = np.full_like(yard.views[0].image(), value)
    assert_sound(*in_medium(name, flat, clean))
