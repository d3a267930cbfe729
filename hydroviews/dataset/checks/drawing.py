"""Whether layers are what their seed and their parameters give: rain is drawn again, from the scene's own files."""

import json
import logging
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from hydroviews.blender.process import NoBlender
from hydroviews.dataset.build import SAID
from hydroviews.dataset.checks.rain import read_facts
from hydroviews.dataset.rainy_variant import by_optics, same_values
from hydroviews.dataset.request import REQUEST
from hydroviews.dataset.variants import open_clean
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json
from hydroviews.rain.compositing import Layers
from hydroviews.rain.effect import Effect, Rain, fall
from hydroviews.rain.layers import read_layers
from hydroviews.rain.patterns import PATTERN_FILE
from hydroviews.rain.registry import find_effect, parse_pattern
from hydroviews.rain.scene_statistics import SceneStatistics, survey
from hydroviews.scene.scenes import View

logger = logging.getLogger(__name__)

CLOSE = 0.01  # difference of two values of a plane, absolute and relative, that other arithmetic may make
FEW = 1e-4  # share of the pixels that may differ more, at edges


def check_drawing(folder: Path, entry: Mapping[str, Any], every_view: bool) -> list[str]:
    """Draw the layers of a finished scene again, of one view a variant or of all, and compare.

    What cannot be drawn here is told, and is no problem: without Blender, and what the manifest of an older version
    does not know of the capture.

    Args:
        folder: of the scene, whose files are what the manifest says, and which today's code drew.
        entry: what the manifest says of it.
        every_view: all views.
    """
    if not entry["patterns"]:
        return []
    if "capture" not in entry:
        logger.warning("%s: built by an older version: layers were not drawn again", folder)
        return []
    problems = []
    try:
        known = _survey(folder, entry)
    except InputError as error:
        return [str(error)]
    for pattern in entry["patterns"]:
        try:
            problems += _check_variant(folder / pattern, pattern, known, every_view)
        except NoBlender as error:
            logger.warning("%s: layers were not drawn again: %s", folder / pattern, str(error).splitlines()[0])
        except InputError as error:
            problems.append(str(error))
    return problems


def _survey(folder: Path, entry: Mapping[str, Any]) -> SceneStatistics:
    """What the rain knew of the scene.

    Raises:
        InputError: a file cannot be read, or the manifest or the request has odd values.
    """
    said, request = entry["capture"], read_json(folder / REQUEST)
    numbers = said.values() if isinstance(said, dict) and set(said) == set(SAID) else ["none"]
    if not all(value is None or (isinstance(value, int | float) and value > 0) for value in numbers):
        raise InputError(f"{folder}: the manifest's word on its capture", found=said, expected=", ".join(SAID))
    renderer = request.get("lens_renderer", "disk") if isinstance(request, dict) else None
    if renderer not in ("disk", "aperture", "traced"):
        raise InputError(f"{folder / REQUEST}: lens_renderer", found=renderer, expected="disk, aperture or traced")
    return survey(replace(open_clean(folder), **said), 0, renderer)


def _check_variant(variant: Path, name: str, known: SceneStatistics, every_view: bool) -> list[str]:
    """Draw a variant's parameters from its seed, and layers of one view or of all from both.

    Raises:
        NoBlender: it takes Blender, which is not here.
        InputError: a file is missing or odd.
    """
    path = variant / PATTERN_FILE
    facts, pattern = read_facts(path), parse_pattern(name)
    effect, seed = find_effect(pattern.effect), facts.get("seed")
    if type(seed) is not int or seed < 0 or (facts["effect"], facts.get("index")) != (pattern.effect, pattern.index):
        found = {key: facts.get(key) for key in ("effect", "index", "seed")}
        raise InputError(f"{path}: not the pattern {name}", found=found, fix="run the build again")
    known = replace(known, seed=seed)
    rain = effect.place(effect.draw(pattern, known), pattern, known)
    drawn, told = json.loads(json.dumps(dict(rain.parameters))), facts["parameters"]
    odd = sorted(key for key in {*drawn, *told} if not same_values(drawn.get(key), told.get(key)))
    if odd:
        return [f"{path}: not what seed {seed} gives: {', '.join(odd)}"]
    chosen = known.views if every_view else known.views[:1]
    again = tqdm(
        _draw(effect, rain, known.views, chosen), desc=f"{name}: drawing again", total=len(chosen), leave=False
    )
    return [problem for view, layers in again for problem in _compare(variant / "layers" / f"{view.name}.exr", layers)]


def _draw(effect: Effect, rain: Rain, views: Sequence[View], chosen: Collection[View]) -> Iterator[tuple[View, Layers]]:
    """The layers of the chosen ones of a scene's views; what Blender bakes is not kept."""
    names = {view.name for view in chosen}
    for group in by_optics(views, effect):
        with tempfile.TemporaryDirectory(prefix="hydroviews-") as folder:
            prepared = rain.prepare(group[0].camera, Path(folder))
            for view in group:
                if view.name in names:
                    yield view, fall(prepared, view.image(), view)


def _compare(path: Path, drawn: Layers) -> list[str]:
    """What of a layer file is not what was drawn."""
    kept = read_layers(path)
    alike = {name: name in kept and kept[name].shape == plane.shape for name, plane in drawn.items()}
    odd = [name for name, plane in drawn.items() if not alike[name] or _differs(kept[name], plane)]
    return [f"{path}: not what seed and parameters give: {', '.join(odd)}"] if odd else []


def _differs(one: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
    """Whether two planes [H, W] differ by more than arithmetic."""
    return bool(np.mean(~np.isclose(one, other, rtol=CLOSE, atol=CLOSE)) > FEW)
