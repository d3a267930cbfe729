"""DeSplat (Wang et al. 2025): what single views show lies in layers of Gaussians in front of their cameras.

Every training view has a layer (`view_layers.py`) that is composited in front of the scene and learned with it, from
the same loss of the composite,

    L = (1 - lambda) |C - photograph| + lambda (1 - SSIM) + cover_penalty mean(A_d)

No features, no masks. Held-out views show the scene alone, and so does the saved model.

Departures: the authors also punish pixels that the scene leaves to the background, by 0.01 mean(1 - A_s); the layers'
first Gaussians are spread over the picture instead of a small square, and have no harmonics; the densification of the
scene and of layers is ours, a layer may double. Opacities are not reset, as with the authors' layers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from baselines.distractors.view_layers import (
    LayerConfig,
    composited,
    first_layer,
    gradients_of,
    grown,
    layer_arrays,
    layer_from,
    layer_stream,
    learn,
    render_layer,
)
from baselines.gaussian_splatting import GaussianSplatting, warn_if_hidden
from baselines.method import Citation
from baselines.splatting.config import TrainerConfig
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import Plane, photometric_loss
from baselines.splatting.kernels.splats.sh_coefficients import C0
from baselines.splatting.objective import Objective
from baselines.splatting.schedule import LearningRates
from baselines.splatting_profiles import PROFILES_WITHOUT_RESETS
from baselines.training.checkpoints import below
from baselines.training.images import TrainingImages, read_images
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image
from hydroviews.scene.scenes import Scene


@dataclass(frozen=True)
class DeSplatConfig:
    """Splatting, and the layers of the views."""

    splatting: TrainerConfig
    layers: LayerConfig = field(default_factory=LayerConfig)


class DeSplatObjective(Objective):
    """The photometric loss of the scene under each view's own layer."""

    def __init__(self, images: TrainingImages, cameras: Sequence[Camera], config: DeSplatConfig, seed: int) -> None:
        super().__init__(images, config.splatting.lambda_dssim)
        self.cameras, self.config, self.seed = cameras, config.layers, seed
        self._iterations = config.splatting.iterations
        self.layers = {
            view: first_layer(camera, config.layers, layer_stream(seed, view, 0)) for view, camera in enumerate(cameras)
        }
        self._cover = np.zeros(len(cameras))  # mean A_d of each view at its last visit
        self._buffers = BufferPool()  # the scene's render is in the other one

    @property
    def sh_sets(self) -> bool:
        """See Objective; a layer is rendered with its cover."""
        return True

    def __call__(self, image: Image, view: int, iteration: int, buffers: BufferPool) -> tuple[float, Image]:
        """See Objective; the view's layer takes a step."""
        height, width = image.shape[:2]
        target, state = self.target(view, (height, width)), self.layers[view]
        layer = render_layer(state.gaussians, self.cameras[view].resized(width, height), self._buffers)
        loss, grad = photometric_loss(composited(layer, image), target, self.lambda_dssim, buffers=buffers)
        self._cover[view] = layer.cover.mean()
        by_scene, by_layer = gradients_of(layer, image, grad, self.config.cover_penalty)
        state = learn(state, layer, by_layer, iteration / self._iterations, self.config)
        self.layers[view] = grown(state, view, self.config, self.seed)
        return loss + self.config.cover_penalty * float(self._cover[view]), by_scene

    def hidden(self, view: int, size: tuple[int, int]) -> Plane:
        """See Objective: A_d."""
        camera = self.cameras[view].resized(size[1], size[0])
        return np.clip(render_layer(self.layers[view].gaussians, camera, self._buffers).cover, 0, 1)

    @property
    def covered(self) -> float:
        """The mean cover of the layers, each at its view's last visit."""
        return float(self._cover.mean())

    def report(self) -> dict[str, str]:
        """See Objective: the mean cover of the layers, and how many Gaussians they have."""
        number = np.mean([len(state.gaussians) for state in self.layers.values()])
        return {"layers": f"cover {self.covered:.1%} with {number:.0f} Gaussians each"}

    def state_dict(self) -> dict[str, NDArray]:
        """See Objective: every layer's training state."""
        layers = {
            f"layer.{view}.{name}": value
            for view, state in self.layers.items()
            for name, value in layer_arrays(state).items()
        }
        return super().state_dict() | layers | {"cover": self._cover}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """See Objective."""
        super().load_state_dict(arrays)
        self._cover = arrays["cover"].copy()
        for view in self.layers:
            self.layers[view] = layer_from(below(f"layer.{view}", arrays))


# A view is visited some forty times, the authors' a few hundred: steps four times as large, as plain splatting's. A
# layer does not grow, and its cover costs ten times as much, or it takes the detail of small pictures out of the scene.
# It begins faint, as where there are many views each is visited six times: 1.4 dB on clean views of bonsai.
SHORT_LAYERS = LayerConfig(
    opacity=0.02,
    spread=0.5,
    cover_penalty=0.1,
    learning_rates=LearningRates(
        means=3.2e-2, means_final=3.2e-4, sh=0.1 / C0, opacity=0.2, scales=0.2, quaternions=0.04
    ),
    growth=replace(LayerConfig().growth, stop=0),
)


class DeSplat(GaussianSplatting):
    """DeSplat (Wang et al. 2025): each view has its own layer of Gaussians for distractors."""

    citation = Citation(
        title="DeSplat",
        paper="DeSplat: Decomposed Gaussian Splatting for Distractor-Free Rendering",
        authors="Y. Wang, M. Klasson, M. Turkulainen, S. Wang, J. Kannala, A. Solin",
        year=2025,
        link="https://arxiv.org/abs/2411.19756",
        code="https://github.com/AaltoML/desplat",
    )

    profiles: ClassVar[Mapping[str, Any]] = {
        "demo": DeSplatConfig(PROFILES_WITHOUT_RESETS["demo"], SHORT_LAYERS),
        "standard": DeSplatConfig(PROFILES_WITHOUT_RESETS["standard"], SHORT_LAYERS),
        "paper": DeSplatConfig(PROFILES_WITHOUT_RESETS["paper"]),
    }

    def fit(self, scene: Scene, folder: Path) -> None:
        """See Method; layers that cover most of the photographs are said."""
        super().fit(scene, folder)
        assert isinstance(self._objective, DeSplatObjective)
        warn_if_hidden(self._objective.covered, "layers")

    def objective(self, scene: Scene, folder: Path) -> DeSplatObjective:
        """See GaussianSplatting."""
        cameras = [view.camera for view in scene.train_views]
        return DeSplatObjective(read_images(scene.train_views), cameras, self.config, self.seed)
