"""3D Gaussian splatting (Kerbl et al. 2023), trained on the rainy views and, as the ceiling, on the clean ones.

With adaptive density control, as the benchmark's reference rows have it, or with half the Gaussians.
"""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from baselines.clean_wrapper import on_clean
from baselines.method import Citation, Method, TrainingSummary, profile_settings
from baselines.splatting.config import TrainerConfig
from baselines.splatting.files.checkpoints import read_model, write_model
from baselines.splatting.files.ply import SPLATS, write_ply
from baselines.splatting.files.unfiltered import without_filter
from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import Plane
from baselines.splatting.objective import Objective
from baselines.splatting.rasterizer import render
from baselines.splatting.trainer import TrainedScene, train
from baselines.splatting_profiles import BUDGETED, PROFILES
from baselines.training.checkpoints import MODEL, megabytes, settings_of
from hydroviews.errors import InputError
from hydroviews.files.atomic import read_json, write_json
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene

logger = logging.getLogger(__name__)

FOUND = "found.json"  # where methods look for more than the scene in their photographs
# Of a training, in the model.
RECORDED = ("near", "seconds", "device", "extent", "iterations", "residuals", "non_finite")
MASKED = "masked"  # of what is found: share of the photographs' pixels that do not count in the end
MOST = 0.6  # of them, above which what hides rain hides the scene itself


class GaussianSplatting(Method):
    """Plain 3DGS (Kerbl et al. 2023): rain becomes part of the scene."""

    citation = Citation(
        title="3D Gaussian Splatting",
        paper="3D Gaussian Splatting for Real-Time Radiance Field Rendering",
        authors="B. Kerbl, G. Kopanas, T. Leimkühler, G. Drettakis",
        year=2023,
        link="https://arxiv.org/abs/2308.04079",
        code="https://github.com/graphdeco-inria/gaussian-splatting",
        licence="Gaussian-Splatting License (research and evaluation only)",
    )

    profiles: ClassVar[Mapping[str, Any]] = PROFILES

    def __init__(self, config: Any, seed: int) -> None:
        super().__init__(config, seed)
        self.found: dict[str, Any] = {}  # in the photographs, beside the scene
        self._objective: Objective | None = None  # after `fit`
        self._trained: TrainedScene | None = None
        self._model_mb: float | None = None
        self._cameras: tuple[Camera, ...] = ()  # of the training views, after `fit`
        self._buffers = BufferPool()

    @classmethod
    def configuration(cls, profile: str) -> Any:
        """See Method.

        Raises:
            InputError: no such profile.
        """
        return profile_settings(profile, cls.profiles)

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method."""
        self._objective = self.objective(scene, folder)
        settings = settings_of(self.config, method=type(self).__name__)
        self._trained = train(scene, self.splatting, self.seed, folder, self._objective, settings)
        self._cameras = tuple(view.camera for view in scene.train_views)
        if self._objective is not None:
            self.found |= self._objective.report()

    def note_masked(self, share: float) -> None:
        """Keep, for `summary`, the share of the photographs' pixels that are masked; a large one is said."""
        self.found[MASKED] = share
        warn_if_hidden(share)

    def hidden(self, view: int, size: tuple[int, int]) -> Plane | None:
        """See Method."""
        if self._objective is None:
            return None
        hidden, weights = self._objective.hidden(view, size), self._objective.pixel_weights
        if weights is None:
            return hidden
        ignored = weights.hidden(view, size, lambda: self.render(self._cameras[view].resized(size[1], size[0])))
        if hidden is None or ignored is None:
            return ignored if hidden is None else hidden
        return np.asarray(1 - (1 - hidden) * (1 - ignored), np.float32)

    @property
    def splatting(self) -> TrainerConfig:
        """How the Gaussians are trained: the part of the settings of this name, or all there are."""
        config: TrainerConfig = self.config if isinstance(self.config, TrainerConfig) else self.config.splatting
        return config

    def objective(self, scene: Scene, folder: Path) -> Objective | None:
        """What renders are compared with in `fit`, where it is not the photographs; `folder` may keep what it needs.

        What it finds beside the scene it says itself, by `report` and `hidden`.
        """
        return None

    def render(self, camera: Camera) -> Image:
        """See Method; always with our own kernels, so that pixels do not depend on where a model was trained."""
        trained = self._require()
        image, _ = render(
            self.gaussians_for_camera(camera),
            camera,
            near=trained.near,
            antialiased=self.splatting.antialiased,
            buffers=self._buffers,
        )
        return np.clip(image, 0, 1)

    def gaussians_for_camera(self, camera: Camera) -> Gaussians:
        """The Gaussians in the colours that a camera is shown; here all cameras are shown the same."""
        return self._require().gaussians

    def export_gaussians(self) -> Gaussians:
        """The Gaussians as a .ply can hold them."""
        return self._require().gaussians

    def _for_viewers(self) -> Gaussians:
        """What `export_gaussians` gives, for renderers that have no 2D filter."""
        trained, gaussians = self._require(), self.export_gaussians()
        return without_filter(gaussians, trained.cameras, trained.near) if self.splatting.antialiased else gaussians

    def save(self, folder: Path) -> None:
        """Write the exact model, a .ply for viewers, and what was found beside the scene."""
        trained = self._require()
        about = {name: getattr(trained, name) for name in RECORDED} | {"found": bool(self.found)}
        if self.splatting.antialiased:
            about["cameras"] = [_as_numbers(camera) for camera in trained.cameras]
        write_model(folder / MODEL, trained.gaussians, about)
        write_ply(folder / SPLATS, self._for_viewers())
        if self.found:
            write_json(folder / FOUND, self.found)
        self._model_mb = megabytes(folder / MODEL)

    @classmethod
    def load(cls, config: Any, seed: int, folder: Path) -> Self:
        """See Method.

        Raises:
            InputError: the model, or what was found beside it, is missing or damaged.
        """
        gaussians, about = read_model(folder / MODEL)
        method = cls(config, seed)
        if about.pop("found", False):
            method.found = read_json(folder / FOUND)
        about["residuals"] = tuple(about.get("residuals", ()))
        about["cameras"] = tuple(_from_numbers(numbers) for numbers in about.get("cameras", ()))
        method._trained = TrainedScene(gaussians=gaussians, compile_seconds=0.0, **about)
        method._model_mb = megabytes(folder / MODEL)
        return method

    def summary(self) -> TrainingSummary:
        """See Method; `used` lists what was found in the photographs."""
        trained = self._require()
        texts = {name: " and ".join(v) or "nothing" if isinstance(v, list) else v for name, v in self.found.items()}
        used = ", ".join(f"{name} {text}" for name, text in texts.items())
        return TrainingSummary(trained.seconds, len(trained.gaussians), self._model_mb, trained.device, used, "cpu")

    def _require(self) -> TrainedScene:
        if self._trained is None:
            raise InputError(f"{type(self).__name__}: not trained", fix="call fit or load first")
        return self._trained


def _as_numbers(camera: Camera) -> list[float]:
    """A camera for JSON."""
    lens = [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy]
    return [*lens, *camera.world_to_camera.ravel().tolist()]


def _from_numbers(numbers: Sequence[float]) -> Camera:
    width, height, fx, fy, cx, cy, *pose = numbers
    return Camera(int(width), int(height), fx, fy, cx, cy, np.reshape(pose, (4, 4)))


def warn_if_hidden(share: float, what: str = "masks") -> None:
    """Say so where most of the photographs' pixels are hidden from the scene by masks, or by what is named."""
    if share > MOST:
        logger.warning("%s hide %.0f %% of the photographs: the scene is trained on the rest", what, 100 * share)


class BudgetedSplatting(GaussianSplatting):
    """Plain 3DGS with half the Gaussians: pruned by contribution, or at full size by relocation (3DGS-MCMC)."""

    citation = Citation(
        title="3D Gaussian Splatting with a budget",
        paper="3D Gaussian Splatting as Markov Chain Monte Carlo",
        authors="S. Kheradmand, D. Rebain, G. Sharma, W. Sun, J. Tseng, H. Isack, A. Kar, A. Tagliasacchi, K. M. Yi",
        year=2024,
        link="https://arxiv.org/abs/2404.09591",
    )

    profiles: ClassVar[Mapping[str, Any]] = BUDGETED


# The references of every table; other methods are shown the clean views by `NAME+clean`.
GaussianSplattingClean, BudgetedSplattingClean = on_clean(GaussianSplatting), on_clean(BudgetedSplatting)
