"""What every method promises, a check a promise; those about interruptions are in `interruptions`.

A check returns what it saw; it raises `Failed` where the promise is broken, `NotTestable` where there is no telling.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from baselines.method import Method, TrainingSummary, check_render
from hydroviews.errors import InputError
from hydroviews.profiles import PROFILES
from hydroviews.scene.images import write_png
from hydroviews.scene.masks import write_ignored
from hydroviews.scene.scenes import View
from hydroviews.scene.seeds import generator
from leaderboard.contract.case import (
    ODD_SIZE,
    Case,
    Failed,
    NotTestable,
    equal,
    files_in,
    must_equal,
    must_refuse,
    some,
)
from leaderboard.contract.toy_scene import HEIGHT, WIDTH
from leaderboard.runs.own_files import in_the_way, left_by_the_method
from leaderboard.runs.run import as_json

HIDDEN = slice(8, 24), slice(10, 34)  # rows and columns that masks hide


def found(case: Case) -> str:
    """A class of its own, found by its name."""
    return f"{case.kind.__module__}:{case.kind.__qualname__}, trains on {case.kind.trains_on} views"


def configurations(case: Case) -> str:
    """A configuration for every profile that is not refused: a dataclass that a record can hold."""
    claimed = []
    for profile in PROFILES:
        try:
            config = case.kind.configuration(profile)
        except InputError:
            continue
        if as_json(case.name, config) != as_json(case.name, case.kind.configuration(profile)):
            raise Failed(f"{profile}: asked again, another configuration")
        claimed.append(profile)
    if not claimed:
        raise Failed(f"none for {', '.join(PROFILES)}")
    must_refuse("a profile that there is not", lambda: case.kind.configuration("no-such-profile"))
    return ", ".join(claimed)


def training(case: Case) -> str:
    """It trains."""
    whole = as_json(case.name, case.kind.configuration(case.profile)) == as_json(case.name, case.config())
    method = case.trained
    length = "as long as it is configured (nothing to shorten)" if whole else f"{case.steps} steps"
    return f"{len(case.scene.train_views)} views of {WIDTH}x{HEIGHT}, {length}, seed {method.seed}"


def rendering(case: Case) -> str:
    """Any camera: right size, float32, [0, 1], and twice the same."""
    camera = case.scene.test_views[0].camera
    turned = camera.world_to_camera.copy()
    turned[[0, 2]] *= -1
    for asked in (camera, camera.resized(*ODD_SIZE), replace(camera, world_to_camera=turned)):
        image = case.trained.render(asked)
        try:
            check_render(image, asked)
        except ValueError as why:
            raise Failed(str(why)) from None
        kept = image.copy()
        again = case.trained.render(asked)
        if not np.array_equal(kept, again):
            raise Failed("asked again, other pixels")
        again[:] = 0.5
        if not np.array_equal(kept, image):
            raise Failed("one render writes into the array of an earlier one")
    return f"{WIDTH}x{HEIGHT}, {ODD_SIZE[0]}x{ODD_SIZE[1]}, turned away: finite float32 in [0, 1]"


def saving(case: Case) -> str:
    """A saved model loads with the same pixels and is in nobody's way; an empty folder is refused."""
    folder = case.folder / "trained"
    case.trained.save(folder)
    if left := in_the_way(folder):
        raise Failed(left_by_the_method(left))
    must_equal(case.renders(case.kind.load(case.config(), 0, folder)), case.pixels, "loaded, it renders other pixels")
    empty = case.folder / "empty"
    empty.mkdir()
    must_refuse("a folder without a model", lambda: case.kind.load(case.config(), 0, empty))
    return f"the same pixels, from {some(files_in(folder))}"


def summary(case: Case) -> str:
    """Time and size, with the right types; asked for after saving, as runs do."""
    case.trained.save(case.folder / "trained")
    found = case.trained.summary()
    if not isinstance(found, TrainingSummary):
        raise Failed(f"{type(found).__name__}, expected baselines.method.TrainingSummary")
    size = "size unknown" if found.model_mb is None else f"{found.model_mb:.3f} MB"
    return f"{found.train_seconds:.2f} s, {size}, {found.device}"


def same_seed(case: Case) -> str:
    """The same seed gives the same pixels; another may give others."""
    again = case.renders(case.train(case.scene, "again"))
    case.must_match(again, case.pixels, "trained again with the same seed, it renders other pixels")
    other = case.renders(case.train(case.scene, "other-seed", seed=1))
    return f"the same pixels; with seed 1 {'the same' if equal(other, case.pixels) else 'others'}"


def held_out(case: Case) -> str:
    """Nothing is learned from held-out pictures, though they lie beside the others."""
    scene = case.room("held-out")
    for view in scene.test_views:
        write_png(view.path, _noise(view.name))
    pixels = case.renders(case.train(scene, "held-out"))
    case.must_match(pixels, case.pixels, "with other held-out pictures, it renders other pixels")
    return "with noise in their place, the same pixels"


def masks(case: Case) -> str:
    """What a mask hides is not looked at."""
    pixels = []
    for take in ("one", "two"):
        scene = case.room(f"masked-{take}")
        views = [_hidden(view, take) if view.name in scene.split.train else view for view in scene.views]
        pixels.append(case.renders(case.train(replace(scene, views=tuple(views)), f"masked-{take}")))
    case.must_match(pixels[0], pixels[1], "other hidden pixels lead to other rendered ones")
    return "with other pixels behind them, the same render"


def unreadable(case: Case) -> str:
    """A photograph that is missing or of another shape is refused."""
    for what, content in (("missing", None), ("of another shape", np.zeros((HEIGHT, WIDTH // 2, 3), np.uint8))):
        scene = case.room(what)
        path = scene.train_views[-1].path
        path.unlink()
        if content is not None:
            write_png(path, content)
        must_refuse(f"a photograph that is {what}", partial(case.train, scene, what))
    return "missing, of another shape: refused"


def fitted_twice(case: Case) -> str:
    """A training that has ended is not changed by a second `fit` in its folder."""
    finished = case.renders(case.train(case.scene, "finished"))
    left = _checkpoint(case, "finished")
    pixels = case.renders(case.train(case.scene, "finished"))
    must_equal(pixels, finished, "fitted again in the same folder, it renders other pixels")
    return f"the same pixels, {some(left)} there"


def foreign(case: Case) -> str:
    """A checkpoint of another seed, other photographs or other settings is refused."""
    case.train(case.scene, "foreign")
    left = _checkpoint(case, "foreign")
    shorter = case.config(max(1, case.steps // 2))
    trials: dict[str, Callable[[], Method]] = {
        "seed": lambda: case.train(case.scene, "foreign", seed=1),
        "photographs": lambda: case.train(case.room("repainted", seed=1), "foreign"),
        "settings": lambda: case.train(case.scene, "foreign", config=shorter),
    }
    if as_json(case.name, shorter) == as_json(case.name, case.config()):
        del trials["settings"]
    for what, trial in trials.items():
        must_refuse(f"a checkpoint ({some(left)}) with other {what}", trial)
    return f"other {', '.join(trials)}: refused"


def _checkpoint(case: Case, run: str) -> list[str]:
    left = files_in(case.folder / run)
    if not left:
        raise NotTestable("fit leaves no checkpoint")
    return left


def _noise(name: str) -> NDArray[np.uint8]:
    return generator(0, "noise", name).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)


def _hidden(view: View, take: str) -> View:
    """The view with a mask, behind which stands something else in every take."""
    image, ignored = view.image(), np.zeros((HEIGHT, WIDTH), bool)
    ignored[HIDDEN] = True
    image[HIDDEN] = generator(0, "hidden", take, view.name).random(3)
    mask = view.path.with_name(f"mask-{view.path.name}")
    write_png(view.path, image)
    write_ignored(mask, ignored)
    return replace(view, mask=mask)
