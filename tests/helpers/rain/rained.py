"""Views in the rain that was drawn, composited from what their files would hold."""

import json
from typing import Any, NamedTuple

import numpy as np

from hydroviews.rain.compositing import Layers
from hydroviews.rain.effect import Effect, fall
from hydroviews.rain.patterns import Pattern
from hydroviews.rain.scene_statistics import SceneStatistics
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import View


class Rained(NamedTuple):
    """A rainy view, its layers, and the parameters."""

    picture: Image
    layers: Layers
    parameters: dict[str, Any]


def rained(
    effect: Effect,
    drawn: Any,
    pattern: Pattern,
    statistics: SceneStatistics,
    view: View | None = None,
    clean: Image | None = None,
) -> Rained:
    """A view in drawn rain: the scene's first unless another is given, as it is unless a picture is given."""
    view = view or statistics.views[0]
    clean = view.image() if clean is None else clean
    rain = effect.place(drawn, pattern, statistics)
    parameters = json.loads(json.dumps(dict(rain.parameters)))
    layers = fall(rain.prepare(view.camera, view.path.parent), clean, view)
    return Rained(effect.composite(parameters, clean, layers), layers, parameters)


def harm(effect: Effect, drawn: Any, pattern: Pattern, statistics: SceneStatistics) -> float:
    """The mean square of what drawn rain changes in the sampled views."""
    pairs = zip(statistics.sampled_views, statistics.samples, strict=True)
    changes = [rained(effect, drawn, pattern, statistics, *pair).picture - pair[1] for pair in pairs]
    return float(np.mean([np.mean(change**2) for change in changes]))
