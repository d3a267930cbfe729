"""What every effect promises: a view follows from seed and parameters, whatever the scene; nothing is out of range."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hydroviews.rain.effect import fall
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.registry import find_effect, registered_effects
from hydroviews.rain.scene_statistics import Light

BAKED = {"raindrop", "raindrop-renewed", "raindrop-sharp", "window", "shower"}  # by Blender: tests of lenses have them
EFFECTS = sorted(registered_effects().keys() - BAKED)


def rained(name, statistics, clean=None):
    """The first view in medium rain, composited from what its files would hold; its layers, and the view as it was."""
    effect, pattern, view = find_effect(name), Pattern(name, 1), statistics.views[0]
    rain = effect.place(effect.draw(pattern, statistics), pattern, statistics)
    clean = view.image() if clean is None else clean
    layers = fall(rain.prepare(view.camera, view.path.parent), clean, view)
    return effect.composite(json.loads(json.dumps(dict(rain.parameters))), clean, layers), layers, clean


def assert_sound(rainy, layers, clean):
    assert rainy.shape == clean.shape
    assert 0 <= rainy.min() <= rainy.max() <= 1
    assert all(np.isfinite(plane).all() for plane in layers.values())


@pytest.mark.parametrize("name", EFFECTS)
def test_it_changes_the_view_by_the_planes_it_names(name, yard):
    rainy, layers, clean = rained(name, yard)
    assert_sound(rainy, layers, clean)
    assert layers.keys() == find_effect(name).planes.keys()
    assert np.abs(rainy - clean).max() > 0.01


@pytest.mark.parametrize("name", EFFECTS)
def test_the_seed_decides(name, yard):
    first, again, other = (rained(name, replace(yard, seed=seed))[0] for seed in (0, 0, 1))
    assert first.tobytes() == again.tobytes() != other.tobytes()


@pytest.mark.parametrize("name", EFFECTS)
def test_one_view_is_enough(name, yard):
    assert_sound(*rained(name, replace(yard, views=yard.views[:1], samples=yard.samples[:1])))


@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize("value", [0.0, 1.0])
def test_black_and_saturated_scenes(name, value, yard):
    """There is no detail: no harm is wanted, and nothing may divide by it."""
    samples = tuple(np.full_like(sample, value) for sample in yard.samples)
    flat = replace(yard, samples=samples, detail=0.0, light=Light((value,) * 3, (value,) * 3))
    clean = np.full_like(yard.views[0].image(), value)
    assert_sound(*rained(name, flat, clean))
