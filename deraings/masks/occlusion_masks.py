"""Occlusion masks learned with the scene (DeRainGS, section "Scene Reconstruction").

The photometric loss l of every pixel is weighed by 1 - M, and M is what a network sees in the photograph:

    L = mean((1 - M) l) + lambda_reg mean(M^2) + penalty mean(M)

The Gaussians and the network minimise the same L, a step of the network to every few of the Gaussians. A network free
to choose every pixel ends at M = (l - penalty) / (2 lambda_reg), clipped to [0, 1]; ours, of limited size and shared by
all views, at what places that look alike have in common. lambda_reg and the penalty are multiples of the typical loss,
a running median, so that masks neither take everything nor nothing: at the default, the half of all pixels whose loss
is below the median is worth no mask, whatever the scene's level. The paper has no penalty.

What is hard to learn of the scene has high losses, too, but elsewhere in every view, where water on the lens stays. So
the loss is weighed by no more of M than the views taken before and after have there on average.
"""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.masking.pixel_weights import Comparison, PixelWeights
from baselines.training.checkpoints import below
from baselines.training.images import Size, TrainingImages
from baselines.training.torch_state import module_arrays, one_thread, restore_module
from deraings.image_planes import Plane, resized
from deraings.lens.views import AROUND, mean_around
from deraings.masks.config import MaskConfig
from deraings.masks.maps import evidence, filled
from deraings.masks.network import CUTOFF, FINE, SHRINK, WIDTH, MaskNetwork, masked_loss
from hydroviews.scene.images import Image

WARM_UP = 0.2  # share of the iterations for which the network learns before masks weigh the loss
LEAST_TYPICAL = 0.02  # least that the typical loss is taken to be, so that well-fitted scenes stay unmasked
LEVEL_MEMORY = 100  # network steps over which the typical loss is averaged


class OcclusionMasks(PixelWeights):
    """The masks of a scene's training views, and the network that they come from.

    A view's mask is the one that the network last learned from, or if it never has, one predicted when asked for. So
    where the network learns in the same iteration, before the weights are asked for, both steps have the same L.
    Nothing depends on torch's threads or global random numbers: on the CPU the same seed, losses and calls give the
    same bits.
    """

    def __init__(
        self,
        images: TrainingImages,
        iterations: int,
        seed: int,
        config: MaskConfig | None = None,
        known: Callable[[int], Plane] | None = None,
        wet: bool = False,
        device: str = "cpu",
    ) -> None:
        """Start with a network that masks next to nothing.

        Args:
            images: what masks are predicted from: the photographs, or what is left of them after enhancement.
            iterations: of the whole training.
            seed: of the network's first weights.
            config: settings.
            known: what of the lens drops hide about the time of a view [h, w], [0, 1], as somebody tells from the
                photographs; hidden as well where something is on the lens.
            wet: whether drops are on the lens, as predicted from the photographs; else the losses decide.
            device: where the network calculates, "cpu" or "cuda".
        """
        self.config = config or MaskConfig()
        self.images, self.seed = images, seed
        self.first = round(self.config.start * iterations)
        self.first_lesson = round(max(0.0, self.config.start - WARM_UP) * iterations)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            network = MaskNetwork(SHRINK, FINE, WIDTH, CUTOFF, extra=1, attention=self.config.attention)
        self.network = network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self._device = torch.device(device)
        self.adam = torch.optim.Adam(self.network.parameters(), self.config.rate, fused=True)
        self._level = np.zeros(2)  # typical loss, and from how many losses it is known
        self._evidence: float | None = None  # for something on the lens, once the masks have started
        self._losses: dict[int, Plane] = {}  # last losses of views at the network's resolution
        self._kept: dict[int, NDArray[np.uint8]] = {}  # masks of views at the mask's resolution
        self._on_lens: dict[int, NDArray[np.uint8]] = {}  # what of them is on the lens
        self._known, self._wet = known, wet

    def weigh(self, seen: Comparison) -> Plane | None:
        """See PixelWeights: 1 - M, once the masks have learned, if they are due."""
        if self.due(seen.iteration):
            self.learn(seen.view, seen.losses(), seen.iteration)
        return self.weights(seen.view, seen.size, seen.iteration)

    def hidden(self, view: int, size: Size, render: Callable[[], Image]) -> Plane:
        """See PixelWeights: what of M is on the lens."""
        return self.mask(view, size)

    def due(self, iteration: int) -> bool:
        """Whether the network should learn in this iteration."""
        return self.needed and iteration >= self.first_lesson and iteration % self.config.every == 0

    @property
    def needed(self) -> bool:
        """Whether something is on the lens; taken for granted until the masks start. One witness is enough."""
        return self._wet or self._evidence is None or self._evidence >= self.config.min_evidence

    def report(self) -> dict[str, float | bool]:
        """For the record: `evidence` for masks, whether they were `used`, and `mask_mean`."""
        means = [float(mask.mean()) / 255 for mask in self._on_lens.values()]
        used = self._evidence is not None and self.needed
        return {
            "evidence": round(self._evidence or 0.0, 3),
            "used": used,
            "mask_mean": round(float(np.mean(means)), 4) if used and means else 0.0,
        }

    def weights(self, view: int, size: Size, iteration: int) -> Plane | None:
        """1 - M of a training view, [H, W] in [0, 1]; None before masks start, or where nothing is on the lens.

        Args:
            view: its index.
            size: height and width wanted.
            iteration: of the training.
        """
        if iteration < self.first:
            return None
        if self._evidence is None:
            self._evidence = evidence([self._losses[view] for view in sorted(self._losses)])
        if not self.needed:
            return None
        if view not in self._kept:
            self._keep(view, self._predicted(view))
        return 1 - self.mask(view, size)

    def mask(self, view: int, size: Size) -> Plane:
        """What of M is on the lens of a training view, [H, W] in [0, 1]; asking for it changes nothing."""
        if not self.needed:
            return np.zeros(size, np.float32)
        own = self._on_lens[view] if view in self._on_lens else self._limited(view, self._predicted(view))
        mask = own.astype(np.float32) / 255
        height, width = self.images.pixels(view).shape[:2]
        pixels = SHRINK // FINE
        whole = resized(mask, (mask.shape[0] * pixels, mask.shape[1] * pixels))
        found = resized(whole[:height, :width], size)
        if self._known is not None:
            more = 1 - found
            more *= resized(self._known(view), size)
            found = np.minimum(more + found, np.float32(1))  # what is known may be a little more by rounding
        return found

    def learn(self, view: int, loss: NDArray, iteration: int) -> None:
        """One step of the network.

        Args:
            view: index of the training view.
            loss: what each pixel adds to the photometric loss before it is weighed, [H, W], at any size of the view.
            iteration: of the training; nothing is learned before it is `due` for the first time.
        """
        loss = np.where(np.isfinite(loss), loss, 0)
        if iteration < self.first_lesson or not (loss > 0).any():
            return
        self._observe(float(np.median(loss[loss > 0])))
        wanted = torch.from_numpy(self._shrunk(view, loss, SHRINK // FINE)).to(self._device)
        self._losses[view] = self._shrunk(view, loss, SHRINK)
        with one_thread():
            self.network.train()
            self.adam.zero_grad()
            mask = self._predict(view)
            penalty = self.config.penalty * self.typical
            (masked_loss(mask, wanted, self.regulariser, penalty) / self.regulariser).backward()
            self.adam.step()
        self._keep(view, _rounded(mask))

    @property
    def regulariser(self) -> float:
        """lambda_reg as it is now."""
        return self.config.regularisation * self.typical

    @property
    def typical(self) -> float:
        """The median loss of a pixel, averaged over the last lessons, and at least `LEAST_TYPICAL`."""
        return max(float(self._level[0]), LEAST_TYPICAL)

    def state_dict(self) -> dict[str, NDArray]:
        """All that was learned: weights, batch statistics, moments, typical loss, loss on the lens, masks."""
        arrays = module_arrays(self.network, self.adam)
        arrays |= {f"loss.{view}": loss.copy() for view, loss in self._losses.items()}
        arrays |= {f"mask.{view}": mask for view, mask in self._kept.items()}
        arrays |= {f"on_lens.{view}": mask for view, mask in self._on_lens.items()}
        if self._evidence is not None:
            arrays["evidence"] = np.array([self._evidence])
        return {**arrays, "level": self._level.copy()}

    def load_state_dict(self, arrays: dict[str, NDArray]) -> None:
        """Take back what `state_dict` returned."""
        restore_module(self.network, arrays, self.adam)
        self._level = arrays["level"].copy()
        self._evidence = float(arrays["evidence"][0]) if "evidence" in arrays else None
        self._losses, self._kept, self._on_lens = (
            {int(view): plane for view, plane in below(part, arrays).items()} for part in ("loss", "mask", "on_lens")
        )

    def _keep(self, view: int, mask: NDArray[np.uint8]) -> None:
        self._kept[view], self._on_lens[view] = mask, self._limited(view, mask)

    def _limited(self, view: int, mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """A mask, nowhere more than the mean of those of the views taken before and after, and itself."""
        mean = mean_around(view, {**self._kept, view: mask}, mask.shape, AROUND)
        return mask if mean is None else np.minimum(mask, np.rint(mean).astype(np.uint8))

    def _predicted(self, view: int) -> NDArray[np.uint8]:
        """M as the network predicts it without learning."""
        with one_thread(), torch.no_grad():
            self.network.eval()
            return _rounded(self._predict(view))

    def _predict(self, view: int) -> Tensor:
        """M [h, w] at the mask's resolution; rows and columns that fill up the last blocks are part of it."""
        pixels = self.images.pixels(view)
        picture = filled(pixels, SHRINK)
        size = picture.shape[0] // SHRINK, picture.shape[1] // SHRINK
        around = torch.from_numpy(self._around(view, size)).to(self._device)[None, None]
        planes = torch.from_numpy(picture).to(self._device).float() / 255
        return self.network(planes.permute(2, 0, 1)[None], around)[0, 0]

    def _shrunk(self, view: int, loss: NDArray, factor: int) -> Plane:
        """A loss map averaged over factor x factor pixels of the whole picture."""
        height, width = self.images.pixels(view).shape[:2]
        whole = filled(resized(loss.astype(np.float32), (height, width)), SHRINK)
        return resized(whole, (whole.shape[0] // factor, whole.shape[1] // factor))

    def _observe(self, typical: float) -> None:
        level, count = self._level
        count = min(count + 1, LEVEL_MEMORY)
        self._level = np.array([level + (typical - level) / count, count])

    def _around(self, view: int, size: Size) -> Plane:
        """Mean loss of the views taken before and after at the same place on the lens, in typical losses; not its own.

        What stays on the lens is lost in all of them, what is fine in the scene moves from view to view.
        """
        others = {other: loss for other, loss in self._losses.items() if other != view}
        mean = mean_around(view, others, size, AROUND)
        return np.ones(size, np.float32) if mean is None else mean / np.float32(self.typical)


def _rounded(mask: Tensor) -> NDArray[np.uint8]:
    return np.rint(mask.detach().cpu().numpy() * 255).astype(np.uint8)
