"""Methods that learn one colour in small steps: one that keeps the contract, and others that each break it once."""

import hashlib
import json
import multiprocessing
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from baselines.method import Method, TrainingSummary
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image, read_image
from hydroviews.scene.scenes import Scene, View
from hydroviews.scene.seeds import generator

PAUSE = 0.003  # seconds a step, at least


@dataclass(frozen=True)
class Config:
    iterations: int = 100_000
    rate: float = 0.05


@dataclass(frozen=True)
class ObjectConfig(Config):
    schedule: object = field(default_factory=object)


class Good(Method):
    """Moves its colour towards that of a view drawn at random, step by step."""

    checkpoint = "checkpoint.json"

    def __init__(self, config: Config, seed: int) -> None:
        super().__init__(config, seed)
        self.state = 0, [0.5, 0.5, 0.5], 0.0  # steps, colour, seconds

    @classmethod
    def configuration(cls, profile: str) -> Any:
        if profile not in ("demo", "standard"):
            raise InputError(f"PROFILE={profile}: unknown")
        return Config()

    def fit(self, scene: Scene, folder: Path) -> None:
        colours = [self.colour_of(view) for view in scene.train_views]
        self.load_state_dict(folder / self.checkpoint, self.fingerprint(colours))
        try:
            self.learn(colours)
        finally:
            state = {"fingerprint": self.fingerprint(colours), "state": self.state}
            write_json(folder / self.checkpoint, state)

    def learn(self, colours: list) -> None:
        while self.state[0] < self.config.iterations:
            self.step(colours)

    def step(self, colours: list) -> None:
        done, colour, seconds = self.state
        start = time.perf_counter()
        time.sleep(PAUSE)
        target = colours[self.draw(done, len(colours))]
        moved = [c + self.config.rate * (t - c) for c, t in zip(colour, target, strict=True)]
        self.state = done + 1, moved, seconds + time.perf_counter() - start

    def draw(self, step: int, n_views: int) -> int:
        return int(generator(self.seed, "view", step).integers(n_views))

    def colour_of(self, view: View) -> list[float]:
        image, ignored = view.image(), view.ignored()
        return (image if ignored is None else image[~ignored]).reshape(-1, 3).mean(axis=0).tolist()

    def fingerprint(self, colours: list) -> dict:
        digest = hashlib.sha256(json.dumps(colours).encode()).hexdigest()
        return {"config": asdict(self.config), "seed": self.seed, "colours": digest}

    def load_state_dict(self, path: Path, expected: dict) -> None:
        if path.is_file():
            kept = read_json(path)
            if kept["fingerprint"] != expected:
                raise InputError(f"{path}: of another run")
            self.state = tuple(kept["state"])

    def render(self, camera: Camera) -> Image:
        return np.broadcast_to(np.float32(self.state[1]), (camera.height, camera.width, 3)).copy()

    def save(self, folder: Path) -> None:
        write_json(folder / "model.json", self.state)

    @classmethod
    def load(cls, config: Config, seed: int, folder: Path) -> Self:
        method = cls(config, seed)
        method.state = tuple(read_json(folder / "model.json"))
        return method

    def summary(self) -> TrainingSummary:
        return TrainingSummary(self.state[2], None, 0.001, "cpu")


def _toy(base: type[Good] = Good, **parts: object) -> type[Good]:
    """The good method with other parts."""
    return type("Toy", (base,), parts)


def _after_fit(deed: Callable[[], object]) -> type[Good]:
    """Trains as the good method does, and then does something where training has a process of its own."""

    def fit(self: Good, scene: Scene, folder: Path) -> None:
        Good.fit(self, scene, folder)
        if multiprocessing.parent_process():
            deed()

    return _toy(fit=fit)


AnyProfile = _toy(configuration=classmethod(lambda cls, profile: Config()))
Unrecordable = _toy(configuration=classmethod(lambda cls, profile: Good.configuration(profile) and {"iterations": 3}))
HoldsAnObject = _toy(configuration=classmethod(lambda cls, profile: ObjectConfig()))
NoCheckpoint = _toy(fit=lambda self, scene, _: self.learn([self.colour_of(view) for view in scene.train_views]))
LeavesThread = _after_fit(lambda: threading.Thread(target=time.sleep, args=(60,), name="follower").start())
LeavesProcess = _after_fit(lambda: subprocess.Popen(["sleep", "600"]))
OneSize = _toy(render=lambda *_: np.full((36, 48, 3), 0.5, np.float32))
Doubles = _toy(render=lambda self, camera: Good.render(self, camera).astype(np.float64))
TooBright = _toy(render=lambda self, camera: Good.render(self, camera) + np.float32(0.6))
ExitsWhenRendering = _toy(render=lambda *_: os._exit(0))
HangsWhenRendering = _toy(render=lambda *_: time.sleep(600))
NoTime = _toy(summary=lambda self: TrainingSummary(float("nan"), None, None, "cpu"))
TellsDevice = _toy(summary=lambda self: replace(Good.summary(self), device=os.environ["HYDROVIEWS_DEVICE"]))
Unseeded = _toy(draw=lambda self, step, n_views: int(np.random.default_rng().integers(n_views)))
LooksBehindMasks = _toy(colour_of=lambda self, view: view.image().mean(axis=(0, 1)).tolist())


class InTheWay(Good):
    def save(self, folder: Path) -> None:
        super().save(folder)
        (folder / "renders").write_text("mine")


class Crashes(Good):
    def fit(self, scene: Scene, folder: Path) -> None:
        raise ArithmeticError("diverged\nat step 7")


class CrashesWhenRendering(Good):
    def render(self, camera: Camera) -> Image:
        os.kill(os.getpid(), signal.SIGSEGV)
        return super().render(camera)


class OneArray(Good):
    """Every render of a size is the same array."""

    def render(self, camera: Camera) -> Image:
        self.arrays = getattr(self, "arrays", {})
        array = self.arrays.setdefault((camera.height, camera.width), super().render(camera))
        array[:] = np.float32(self.state[1])
        return array


class Rounds(Good):
    def save(self, folder: Path) -> None:
        write_json(folder / "model.json", [self.state[0], np.round(self.state[1], 2).tolist(), self.state[2]])


class OnACard(Good):
    """Never ends with the same bits."""

    def step(self, colours: list) -> None:
        super().step(colours)
        done, colour, seconds = self.state
        self.state = done, [c + 1e-6 * np.random.default_rng().random() for c in colour], seconds

    def summary(self) -> TrainingSummary:
        return replace(super().summary(), device="a card")


ExactOnACard = _toy(OnACard, step=Good.step)


class Peeks(Good):
    def fit(self, scene: Scene, folder: Path) -> None:
        shown = {view.path for view in scene.views}
        beside = set(scene.views[0].path.parent.glob("view-*.png")) - shown
        self.beside = [read_image(path).mean() for path in sorted(beside)]
        super().fit(scene, folder)

    def colour_of(self, view: View) -> list[float]:
        return [c * float(np.mean(self.beside)) for c in super().colour_of(view)]


class ForgetsWhatIsBad(Good):
    def colour_of(self, view: View) -> list[float]:
        if not view.path.is_file():
            raise FileNotFoundError(view.path)
        return super().colour_of(view)


class TakesAnything(Good):
    def load_state_dict(self, path: Path, expected: dict) -> None:
        if path.is_file():
            self.state = tuple(read_json(path)["state"])


class GoesOnElsewhere(Good):
    """Draws views anew when it is taken up again."""

    def load_state_dict(self, path: Path, expected: dict) -> None:
        super().load_state_dict(path, expected)
        self.first = self.state[0]

    def draw(self, step: int, n_views: int) -> int:
        return super().draw(step - self.first, n_views)


class EndsWhenInterrupted(Good):
    """Takes Ctrl-C for the end of the training."""

    def fit(self, scene: Scene, folder: Path) -> None:
        try:
            super().fit(scene, folder)
        except KeyboardInterrupt:
            return
