"""The Gaussians' colours in a view: by the look of its photograph as a whole, and by that of each place (Wild-GS).

For the second, the photograph's visible pixels are lifted to points by the depth that is rendered of the view, and the
points are turned into a triplane, of which each Gaussian reads at its position. Depths change slowly: one that has been
rendered serves a view's next visits for some hundred steps.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.encoders.appearance import EncodedAppearance
from baselines.encoders.unet import at_size
from baselines.splatting.gaussians import Gaussians
from baselines.training.checkpoints import below
from baselines.training.images import TrainingImages
from baselines.wild_gs.colours import LookColours
from baselines.wild_gs.config import LookConfig
from baselines.wild_gs.encoder import LookEncoder
from baselines.wild_gs.lifting import lifted, lifted_size, rendered_depth
from baselines.wild_gs.triplane import TriplaneNetwork, plane_pictures, read
from hydroviews.scene.cameras import Camera

LEAST_VISIBLE = 0.5  # threshold Th of the paper, which does not give it: only pixels with more visibility are lifted
DEPTH = "depth"  # names of depths in a checkpoint: of which view, rendered in which step


class LookAppearance(EncodedAppearance):
    """Colours in training views."""

    config: LookConfig
    encoder: LookEncoder

    def __init__(
        self,
        images: TrainingImages,
        config: LookConfig,
        sh_degree: int,
        iterations: int,
        seed: int,
        near: float,
        antialiased: bool = False,
    ) -> None:
        """Start with networks that leave colours as they are.

        Args:
            images: the references.
            config: settings.
            sh_degree: of the Gaussians' colours.
            iterations: of the whole training.
            seed: of the first weights, and of which steps have nothing of the reference.
            near: depths are rendered of what is farther; world units.
            antialiased: as depths are rendered.
        """
        super().__init__(images, config, iterations, seed)
        self._seen_with = near, antialiased
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.encoder = LookEncoder(config.backbone)
            self.triplane = TriplaneNetwork()
            self.colours = LookColours(config, sh_degree, self.encoder.outputs)
        networks = [(network, config.rate_networks) for network in (self.triplane, self.colours)]
        self.optimise([(self.encoder, config.rate_encoder), *networks])
        self._depths: dict[int, tuple[int, NDArray[np.float32]]] = {}  # by view: step in which it was rendered, depth

    def visible_price(self, iteration: int) -> float:
        """See EncodedAppearance: it falls linearly."""
        first, last = self.config.price_first, self.config.price_last
        return first + (last - first) * iteration / max(self.iterations - 1, 1)

    def features(self, gaussians: Gaussians) -> NDArray[np.float32]:
        """See Appearance: nothing of their own yet [N, I]."""
        self.colours.enclose(gaussians.means)
        return np.zeros((len(gaussians), self.config.intrinsic), np.float32)

    def sh_sets(self, parameters: dict[str, Tensor], camera: Camera, view: int, degree: int) -> tuple[Tensor, ...]:
        """See Appearance; one set. Colours move no Gaussian."""
        whole, visible = self._encoded(view)
        positions = self.colours.in_box(parameters["means"].detach())
        if self._absent():
            codes = positions.new_zeros(len(positions), 2 * self.config.code)
        else:
            local = self._steps >= self.config.local_from * self.iterations
            places = self.read(view, visible.detach(), parameters, camera) if local else None
            codes = self.colours.codes(whole, places, positions)
        return (parameters["sh"] + self.colours.added(codes, parameters["features"]),)

    def read(self, view: int, visible: Tensor, parameters: dict[str, Tensor], camera: Camera) -> Tensor:
        """What Gaussians in sight read of a view's triplane [n, C].

        Args:
            view: index of the training view.
            visible: its m [h', w'].
            parameters: of the Gaussians in sight.
            camera: of the view, relative to their origin.
        """
        planes: Tensor = self.triplane(self.pictures(view, visible, parameters, camera))
        return read(planes, self.colours.in_box(parameters["means"].detach()))

    def pictures(self, view: int, visible: Tensor, parameters: dict[str, Tensor], camera: Camera) -> Tensor:
        """What the visible pixels of a view look like on the planes [3, 8, side, side]; for the rest see `read`."""
        height, width = self._images.pixels(view).shape[:2]
        size = lifted_size(height, width, self.config.lifted)
        camera = camera.resized(size[1], size[0])
        depths = torch.from_numpy(self._depth(view, parameters, camera)).to(self.device)
        points = self.colours.in_box(lifted(depths, camera))
        colours = torch.from_numpy(self._images.pixels(view, size)).to(self.device).reshape(-1, 3) / 255
        return plane_pictures(points.nan_to_num(0), colours, self._lifted(view, visible, depths), self.config.side)

    def training_state(self) -> dict[str, NDArray]:
        """See EncodedAppearance; and the depths."""
        depths = {f"{DEPTH}.{view}.{step}": depth for view, (step, depth) in self._depths.items()}
        return {**super().training_state(), **depths}

    def load_training_state(self, arrays: dict[str, NDArray]) -> None:
        """See EncodedAppearance."""
        super().load_training_state(arrays)
        self._depths = {}
        for name, depth in below(DEPTH, arrays).items():
            view, step = name.split(".")
            self._depths[int(view)] = int(step), depth

    def feature_rate(self, iteration: int) -> float:
        """See Appearance."""
        return self.config.rate_intrinsic * self._decay(iteration)

    def _depth(self, view: int, parameters: dict[str, Tensor], camera: Camera) -> NDArray[np.float32]:
        """Of a view; rendered anew if it is due, and whenever nothing is learned. The same if a step is done again."""
        learning = torch.is_grad_enabled()
        if learning and view in self._depths and self._steps - self._depths[view][0] < self.config.renewed:
            return self._depths[view][1]
        depth = rendered_depth(parameters, camera, *self._seen_with)
        if learning:
            self._depths[view] = self._steps, depth
        return depth

    def _lifted(self, view: int, visible: Tensor, depths: Tensor) -> Tensor:
        """Which pixels become points, bool [H W]: those that have a depth, show the scene, and are not hidden."""
        size = (depths.shape[0], depths.shape[1])
        found = depths.isfinite() & (at_size(visible, size) > LEAST_VISIBLE)
        ignored = self._images.ignored(view, size)
        if ignored is not None:
            found &= torch.from_numpy(~ignored).to(self.device)
        return found.flatten()
