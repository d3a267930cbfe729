"""A method and what it is tried on; how what it does is judged."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from baselines.method import Method
from hydroviews.errors import InputError
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene
from leaderboard.contract.toy_scene import draw_room
from leaderboard.runs.train_and_render import only_training

ODD_SIZE = 53, 37


class Failed(Exception):
    """The promise is broken."""


class NotTestable(Exception):
    """There is no telling whether the promise is kept."""


@dataclass(frozen=True)
class Case:
    """A method, and what it is tried on."""

    name: str  # as METHOD= has it
    kind: type[Method]
    profile: str
    steps: int
    folder: Path  # for everything that is written

    def config(self, steps: int | None = None) -> Any:
        """The profile's settings with `steps` training steps, the case's own if not given."""
        return self.kind.with_max_iterations(self.kind.configuration(self.profile), steps or self.steps)

    def room(self, name: str, seed: int = 0) -> Scene:
        """The room drawn into a folder of its own."""
        return draw_room(self.folder / "rooms" / name, seed)

    def train(self, scene: Scene, run: str, seed: int = 0, config: Any = None) -> Method:
        """A method trained in the folder of the run of that name; it is handed the training views alone."""
        folder = self.folder / run
        folder.mkdir(parents=True, exist_ok=True)
        method = self.kind(config or self.config(), seed)
        method.fit(only_training(scene), folder)
        return method

    @cached_property
    def scene(self) -> Scene:
        """The room as it is."""
        return self.room("plain")

    @cached_property
    def trained(self) -> Method:
        """Trained on the room as it is, seed 0."""
        return self.train(self.scene, "trained")

    @cached_property
    def pixels(self) -> list[Image]:
        """What `trained` renders."""
        return self.renders(self.trained)

    def renders(self, method: Method) -> list[Image]:
        """The held-out views, then one of another size."""
        cameras = [view.camera for view in self.scene.test_views]
        return [np.array(method.render(camera)) for camera in [*cameras, cameras[0].resized(*ODD_SIZE)]]

    def must_match(self, found: Sequence[Image], expected: Sequence[Image], otherwise: str) -> None:
        """Whether two trainings led to the same renders, to the bit.

        On a GPU, threads add up in any order. Rounding alone takes two trainings as far apart as another seed does:
        with gradients changed by 1e-7 of themselves, four methods of Gaussians rendered this room after 1,500 steps
        with a PSNR of 14 to 15 dB between twins. So no distance could tell a broken promise.

        Raises:
            Failed: they did not; with `otherwise` and the largest difference.
            NotTestable: they did not, on a GPU.
        """
        try:
            must_equal(found, expected, otherwise)
        except Failed as why:
            device = self.trained.summary().device
            if device == "cpu":
                raise
            raise NotTestable(f"{why}; it trains on {device}, where no two trainings are the same") from None


def files_in(folder: Path) -> list[str]:
    """What lies in a folder and below, hidden files left out."""
    paths = (path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    return sorted(path.as_posix() for path in paths if not path.name.startswith("."))


def some(names: Sequence[str]) -> str:
    """The first name, and how many more there are."""
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def equal(one: Sequence[Image], two: Sequence[Image]) -> bool:
    """Whether two lists of renders are the same to the bit."""
    return all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))


def must_refuse(what: str, action: Callable[[], Any]) -> None:
    """Whether bad input raises InputError.

    Raises:
        Failed: it is taken, or ends with another error.
    """
    try:
        action()
    except InputError:
        return
    except Exception as error:
        raise Failed(f"{what}: {type(error).__name__} instead of InputError: {error}") from error
    raise Failed(f"{what}: taken without a word, expected InputError")


def must_equal(found: Sequence[Image], expected: Sequence[Image], otherwise: str) -> None:
    """Whether two lists of renders are the same to the bit.

    Raises:
        Failed: they are not; with `otherwise` and the largest difference.
    """
    if not equal(found, expected):
        largest = max(float(np.abs(a - b).max()) for a, b in zip(found, expected, strict=True))
        raise Failed(f"{otherwise}, by up to {largest:.2g}")
