"""Methods that train in no time, to test the harness with."""

import errno
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from baselines.method import Method, TrainingSummary
from baselines.training.devices import chosen_device
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.files.full_disk import plain_write_errors
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene


@dataclass(frozen=True)
class Config:
    shift: float = float(os.environ.get("TOY_SHIFT", "0"))


class MeanColour(Method):
    """Renders the mean colour of what it was shown."""

    colour = np.zeros(3)

    @classmethod
    def configuration(cls, profile: str) -> Config:
        return Config()

    def fit(self, scene: Scene, folder: Path) -> None:
        self.colour = np.mean([view.image().mean(axis=(0, 1)) for view in scene.train_views], axis=0)

    def render(self, camera: Camera) -> Image:
        return np.full((camera.height, camera.width, 3), self.colour + self.config.shift, np.float32)

    def hidden(self, view: int, size: tuple[int, int]) -> np.ndarray:
        return np.full(size, 0.25, np.float32)

    def save(self, folder: Path) -> None:
        write_json(folder / "colour.json", self.colour.tolist())

    @classmethod
    def load(cls, config: Config, seed: int, folder: Path) -> "MeanColour":
        method = cls(config, seed)
        method.colour = np.array(read_json(folder / "colour.json"))
        return method

    def summary(self) -> TrainingSummary:
        return TrainingSummary(train_seconds=0.5, n_primitives=None, model_mb=0.001, device="cpu")


def _toy(**parts: object) -> type[MeanColour]:
    """MeanColour with other parts."""
    return type("Toy", (MeanColour,), parts)


def _raises(error: Exception) -> Callable:
    def fail(*_: object) -> None:
        raise error

    return fail


def _after_fit(deed: Callable[[Scene, Path], object]) -> type[MeanColour]:
    """Trains as MeanColour does, and then does something with the scene and the folder."""

    def fit(self: MeanColour, scene: Scene, folder: Path) -> None:
        MeanColour.fit(self, scene, folder)
        deed(scene, folder)

    return _toy(fit=fit)


MeanColourClean = _toy(trains_on="clean")
Raises = _toy(fit=_raises(ArithmeticError("diverged at step 7")))
Refuses = _toy(fit=_raises(InputError("camera.bin: this is no scene for me")))
RefusesToRender = _toy(render=_raises(InputError("camera: too wide for me")))
Rambles = _toy(fit=_raises(ValueError("\ud800\x1b[31m" + 1_000_000 * "x")))
OddConfiguration = _toy(configuration=_raises(ArithmeticError("no settings today")))
Killed = _toy(fit=lambda *_: os.kill(os.getpid(), signal.SIGKILL))
Hangs = _toy(fit=lambda *_: time.sleep(600))
EatsMemory = _toy(fit=lambda *_: np.ones(6 * 10**9, np.uint8))
NoGpu = _toy(fit=lambda *_: chosen_device("cuda:9"))  # finds the machine not as it has to be
RendersTooSmall = _toy(render=lambda self, camera: MeanColour.render(self, camera)[1:])
RendersNan = _toy(render=lambda self, camera: np.float32("nan") * MeanColour.render(self, camera))
NothingLeft = _toy(summary=lambda self: replace(MeanColour.summary(self), n_primitives=0))
NumpyScalars = _toy(summary=lambda self: TrainingSummary(np.float32(0.5), np.int64(7), np.float64(0.001), "cpu"))


class FillsTheDisk(MeanColour):
    def save(self, folder: Path) -> None:
        with plain_write_errors(folder / "colour.json"):
            raise OSError(errno.ENOSPC, "No space left on device")


class PrintsGarbageAndChangesInput(MeanColour):
    """Prints what is no text and what a terminal would obey; moves all cameras and points that it is given."""

    def fit(self, scene: Scene, folder: Path) -> None:
        super().fit(scene, folder)
        sys.stdout.buffer.write(bytes(range(256)) * 100)
        os.write(2, b"\xff\xfe\x00\x1b[2J" * 100)
        scene.points.positions[:] = np.nan
        for view in scene.views:
            view.camera.world_to_camera[:] = 0

    def render(self, camera: Camera) -> Image:
        image = super().render(camera)
        camera.world_to_camera[:] = 0
        return image


class WaitsOnce(MeanColour):
    """Trains for ever the first time it is asked to, as an interrupted run would."""

    def fit(self, scene: Scene, folder: Path) -> None:
        if not (folder / "begun").exists():
            (folder / "begun").touch()
            time.sleep(600)
        super().fit(scene, folder)


def _write_over(scene: Scene, _: Path) -> None:
    for view in scene.train_views:
        view.path.chmod(0o644)
        view.path.write_bytes(b"mine now")


def _forge(scene: Scene, _: Path) -> None:
    """Look for the ground truth around the photographs, and for all other pictures that are not shown."""
    shown = {view.path for view in scene.train_views}
    data = scene.train_views[0].path.parents[2 if scene.train_views[0].path.parent.name == "clean" else 3]
    for path in set(data.rglob("*.png")) - shown:
        path.write_bytes(b"forged")
        raise AssertionError(f"{path} is in reach")


Vandal = _after_fit(_write_over)
VandalAtOnce = _after_fit(lambda scene, folder: (_write_over(scene, folder), scene.train_views[0].image()))
Forger = _after_fit(_forge)


class LeavesInTheWay(MeanColour):
    """Leaves something of its own under the names of the run's files; which, its seed says."""

    def fit(self, scene: Scene, folder: Path) -> None:
        super().fit(scene, folder)
        LEFT[self.seed](folder)


def _as_folder(path: Path) -> None:
    path.unlink(missing_ok=True)
    (path / "deep").mkdir(parents=True)


def _as_file(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.write_text("a model")


LEFT = [
    lambda folder: (folder / "renders").write_bytes(b"x"),
    lambda folder: (folder / "renders").symlink_to("/nowhere"),
    lambda folder: (folder / "renders" / "view-00.png").mkdir(parents=True),
    lambda folder: (folder / "hidden").write_bytes(b"x"),
    lambda folder: _as_folder(folder / "record.json"),
    lambda folder: _as_folder(folder / "prediction.json"),
    lambda folder: _as_folder(folder / "config.json"),
    _as_file,
]


@dataclass(frozen=True)
class ObjectConfig(Config):
    schedule: object = field(default_factory=object)


HoldsAnObject = _toy(configuration=classmethod(lambda cls, profile: ObjectConfig()))
