"""Methods that train in no time, to test the harness with."""

import errno
import os
import shutil
import signal
import sys
import time
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


class MeanColourClean(MeanColour):
    trains_on = "clean"


class Raises(MeanColour):
    def fit(self, scene: Scene, folder: Path) -> None:
        raise ArithmeticError("diverged at step 7")


class Killed(MeanColour):
    def fit(self, scene: Scene, folder: Path) -> None:
        os.kill(os.getpid(), signal.SIGKILL)


class Refuses(MeanColour):
    def fit(self, scene: Scene, folder: Path) -> None:
        raise InputError("camera.bin: this is no scene for me")


class RefusesToRender(MeanColour):
    def render(self, camera: Camera) -> Image:
        raise InputError("camera: too wide for me")


class FillsTheDisk(MeanColour):
    def save(self, folder: Path) -> None:
        with plain_write_errors(folder / "colour.json"):
            raise OSError(errno.ENOSPC, "No space left on device")


class RendersTooSmall(MeanColour):
    def render(self, camera: Camera) -> Image:
        return super().render(camera)[1:]


class EatsMemory(MeanColour):
    def fit(self, scene: Scene, folder: Path) -> None:
        np.ones(6 * 10**9, np.uint8)


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


class RendersNan(MeanColour):
    def render(self, camera: Camera) -> Image:
        return super().render(camera) * np.float32("nan")


class WaitsOnce(MeanColour):
    """Trains for ever the first time it is asked to, as an interrupted run would."""

    def fit(self, scene: Scene, folder: Path) -> None:
        if not (folder / "begun").exists():
            (folder / "begun").touch()
            time.sleep(600)
        super().fit(scene, folder)


class Hangs(MeanColour):
    def fit(self, scene: Scene, folder: Path) -> None:
        time.sleep(600)


class NothingLeft(MeanColour):
    def summary(self) -> TrainingSummary:
        return replace(super().summary(), n_primitives=0)


class Rambles(MeanColour):
    """An error as long as a book, with what is no character; and so is what it used."""

    def fit(self, scene: Scene, folder: Path) -> None:
        raise ValueError("\ud800\x1b[31m" + 1_000_000 * "x")


class OddConfiguration(MeanColour):
    @classmethod
    def configuration(cls, profile: str) -> Config:
        raise ArithmeticError("no settings today")


class Vandal(MeanColour):
    """Writes over the photographs it is shown."""

    def fit(self, scene: Scene, folder: Path) -> None:
        super().fit(scene, folder)
        for view in scene.train_views:
            view.path.chmod(0o644)
            view.path.write_bytes(b"mine now")


class VandalAtOnce(Vandal):
    """And looks at them afterwards."""

    def fit(self, scene: Scene, folder: Path) -> None:
        super().fit(scene, folder)
        scene.train_views[0].image()


class Forger(MeanColour):
    """Looks for the ground truth around the photographs it is shown, and for all other pictures that it is not."""

    def fit(self, scene: Scene, folder: Path) -> None:
        super().fit(scene, folder)
        shown = {view.path for view in scene.train_views}
        data = scene.train_views[0].path.parents[2 if scene.train_views[0].path.parent.name == "clean" else 3]
        for path in set(data.rglob("*.png")) - shown:
            path.write_bytes(b"forged")
            raise AssertionError(f"{path} is in reach")


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


class HoldsAnObject(MeanColour):
    @classmethod
    def configuration(cls, profile: str) -> "ObjectConfig":
        return ObjectConfig()


@dataclass(frozen=True)
class ObjectConfig(Config):
    schedule: object = field(default_factory=object)


class NumpyScalars(MeanColour):
    """Measures as libraries give them."""

    def summary(self) -> TrainingSummary:
        return TrainingSummary(np.float32(0.5), np.int64(7), np.float64(0.001), "cpu")


class NoGpu(MeanColour):
    """Finds the machine not as it has to be."""

    def fit(self, scene: Scene, folder: Path) -> None:
        chosen_device("cuda:9")
