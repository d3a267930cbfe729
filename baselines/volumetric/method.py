"""How a radiance model meets the contract of methods: trained, rendered, saved and loaded. Methods derive from it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray

from baselines.method import Method, TrainingSummary, profile_settings
from baselines.training.checkpoints import MODEL, megabytes, read_arrays, settings_of, write_arrays
from baselines.training.devices import chosen_device
from baselines.training.images import TrainingImages, read_images
from baselines.training.torch_state import module_arrays, restore_module
from baselines.volumetric.config import VolumetricConfig
from baselines.volumetric.losses import Loss, photometric_losses
from baselines.volumetric.model import RadianceModel
from baselines.volumetric.rays.batches import Draw, TrainingPixels
from baselines.volumetric.rays.spaces import Space, space_from
from baselines.volumetric.trainer import TrainedField, train
from hydroviews.errors import InputError
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene


@dataclass(frozen=True)
class _Fitted:
    """A trained field, and on how many views."""

    trained: TrainedField
    views: int  # of the training


class RadianceMethod(Method):
    """A plain radiance field; methods replace its model, loss, batches, and how much each pixel counts."""

    profiles: ClassVar[Mapping[str, Any]]

    def __init__(self, config: Any, seed: int) -> None:
        super().__init__(config, seed)
        self._fitted: _Fitted | None = None
        self._model_mb: float | None = None

    @classmethod
    def configuration(cls, profile: str) -> Any:
        """See Method.

        Raises:
            InputError: no such profile.
        """
        return profile_settings(profile, cls.profiles)

    @property
    def volumetric(self) -> VolumetricConfig:
        """How the field is rendered and trained: the part of the settings of this name, or all there are."""
        config: VolumetricConfig = self.config if isinstance(self.config, VolumetricConfig) else self.config.volumetric
        return config

    def make(self, space: Space, generator: torch.Generator, views: int) -> RadianceModel:
        """The untrained model of a scene with so many training views."""
        return RadianceModel(self.volumetric, space, generator)

    def loss(self) -> Loss:
        """What training minimises."""
        return photometric_losses(self.volumetric)

    def draw(self) -> Draw:
        """Where the pixels of a step are; here evenly drawn from all views."""
        return TrainingPixels.draw

    def weights(
        self, images: TrainingImages, names: Sequence[str], folder: Path
    ) -> Sequence[NDArray[np.float32]] | None:
        """How much each pixel of the training views counts, [H, W] in [0, 1]; `folder` may keep what it needs."""
        return None

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method."""
        views = scene.train_views
        images = read_images(views)
        weights = self.weights(images, [view.name for view in views], folder)
        trained = train(
            scene,
            self.volumetric,
            self.seed,
            folder,
            self.make,
            self.loss(),
            settings=settings_of(self.config, method=type(self).__name__),
            images=images,
            weights=weights,
            draw=self.draw(),
        )
        self._fitted = _Fitted(trained, len(scene.train_views))

    def render(self, camera: Camera) -> Image:
        """See Method."""
        return self._require().trained.model.render(camera)

    def save(self, folder: Path) -> None:
        """See Method."""
        fitted = self._require()
        trained = fitted.trained
        about = {
            "space": trained.model.space.settings(),
            "views": fitted.views,
            "seconds": trained.seconds,
            "device": trained.device,
        }
        write_arrays(folder / MODEL, module_arrays(trained.model), about)
        self._model_mb = megabytes(folder / MODEL)

    @classmethod
    def load(cls, config: Any, seed: int, folder: Path) -> Self:
        """See Method.

        Raises:
            InputError: no model there, or one of another configuration.
        """
        arrays, about = read_arrays(folder / MODEL)
        method = cls(config, seed)
        try:
            model = method.make(space_from(about["space"]), torch.Generator(), about["views"])
            restore_module(model, arrays)
        except (KeyError, RuntimeError) as error:
            raise InputError(
                f"{folder / MODEL}: not a model of this configuration", found=error, fix="train the method again"
            ) from error
        model = model.to(chosen_device(method.volumetric.device))
        method._fitted = _Fitted(TrainedField(model, about["seconds"], about["device"]), about["views"])
        method._model_mb = megabytes(folder / MODEL)
        return method

    def summary(self) -> TrainingSummary:
        """See Method."""
        trained = self._require().trained
        on_gpu = next(trained.model.parameters()).is_cuda
        rendered = torch.cuda.get_device_name() if on_gpu else "cpu"
        return TrainingSummary(trained.seconds, None, self._model_mb, trained.device, render_device=rendered)

    def _require(self) -> _Fitted:
        if self._fitted is None:
            raise InputError(f"{type(self).__name__}: not trained", fix="call fit or load first")
        return self._fitted
