"""Colours by view from the view's own photograph: what methods share that encode it anew in every step.

An encoder makes a code and a visibility mask of the reference picture. Colours learn by way of the code, the mask
learns from the loss that it weighs. Both are cut off from their graph, so that what gathers there goes through the
encoder once.
"""

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from baselines.encoders.config import EncoderConfig
from baselines.encoders.unet import PictureEncoder, at_size
from baselines.splatting.appearance.base import Appearance
from baselines.splatting.schedule import Stream, random_stream
from baselines.training.images import TrainingImages
from baselines.training.torch_state import module_arrays, one_thread, restore_module

STEPS = "steps"
FINAL_RATE = 0.1  # factor of the networks' learning rates at the end (GS-W's authors)


class EncodedAppearance(Appearance):
    """Colours in training views. The reference is encoded anew in every step, so that the encoder learns from each."""

    config: EncoderConfig
    encoder: PictureEncoder

    def __init__(self, images: TrainingImages, config: EncoderConfig, iterations: int, seed: int) -> None:
        """Derived classes add their networks, then call `optimise`.

        Args:
            images: the references.
            config: settings.
            iterations: of the whole training.
            seed: of everything random.
        """
        super().__init__()
        self.config, self.seed, self.iterations = config, seed, iterations
        self._images, self._steps = images, 0
        self._outputs: tuple[Tensor, ...] = ()  # of the encoder, with their graph
        self._leaves: tuple[Tensor, ...] = ()  # the same cut off, where gradients gather

    def optimise(self, groups: Sequence[tuple[nn.Module, float]]) -> None:
        """Give networks to Adam, each with its rate."""
        self._adam = torch.optim.Adam([{"params": list(net.parameters()), "lr": rate} for net, rate in groups])
        self._rates = [rate for _, rate in groups]

    @property
    def device(self) -> torch.device:
        """Where the networks are."""
        return next(self.encoder.parameters()).device

    @abstractmethod
    def visible_price(self, iteration: int) -> float:
        """Weight of mean((1 - m)^2) in the loss."""

    def encode(self, view: int) -> tuple[Tensor, Tensor]:
        """What the encoder makes of a training view: its code, and the visibility mask [h', w']."""
        height, width = self._images.pixels(view).shape[:2]
        multiple = self.encoder.multiple
        size = [max(1, round(side / self.config.shrink / multiple)) * multiple for side in (height, width)]
        pixels = self._images.pixels_once(view, (size[0], size[1])).astype(np.float32) / 255 - 0.5
        picture = torch.from_numpy(pixels).permute(2, 0, 1)[None]
        code, visible = self.encoder(picture.to(self.device))
        return code, visible

    @one_thread()
    @torch.no_grad()
    def hidden(self, view: int, size: tuple[int, int]) -> NDArray[np.float32]:
        """1 - m [H, W] of a training view at (height, width)."""
        return (1 - at_size(self.encode(view)[1], size).clamp(0, 1)).cpu().numpy()

    @one_thread()
    @torch.no_grad()
    def masked(self) -> float:
        """Share of the references' pixels whose m is below 1/2, in the mean over views."""
        return float(np.mean([(self.encode(view)[1] < 0.5).float().mean().item() for view in range(len(self._images))]))

    @property
    def visible(self) -> Tensor:
        """m [h', w'] in (0, 1) of the view that `sh_sets` was asked for last; gradients by it are learned from."""
        return self._leaves[1]

    def learn(self, iteration: int) -> None:
        """See Appearance: what has gathered at the encoder's outputs goes through it once, then Adam steps."""
        leaves, outputs = self._leaves, self._outputs
        given = [(out, leaf.grad) for out, leaf in zip(outputs, leaves, strict=True) if leaf.grad is not None]
        if given:
            torch.autograd.backward([out for out, _ in given], [gradient for _, gradient in given])
        for group, rate in zip(self._adam.param_groups, self._rates, strict=True):
            group["lr"] = rate * self._decay(iteration)
        self._adam.step()
        self._adam.zero_grad()
        self._outputs, self._leaves, self._steps = (), (), iteration + 1

    def training_state(self) -> dict[str, NDArray]:
        """See Appearance."""
        return {**module_arrays(self, self._adam), STEPS: np.array([self._steps])}

    def load_training_state(self, arrays: dict[str, NDArray]) -> None:
        """See Appearance."""
        restore_module(self, arrays, self._adam)
        self._steps = int(arrays[STEPS][0])

    def _encoded(self, view: int) -> tuple[Tensor, ...]:
        """What `encode` returns, cut off from its graph so that several losses send one gradient through it."""
        self._outputs = self.encode(view)
        self._leaves = tuple(output.detach().requires_grad_() for output in self._outputs)
        return self._leaves

    def _absent(self) -> bool:
        """Is this one of the steps that have nothing of the reference? The same whenever it is done again."""
        drawn = random_stream(self.seed, Stream.ABSENCE, self._steps).random()
        return torch.is_grad_enabled() and drawn < self.config.absent

    def _decay(self, iteration: int) -> float:
        return float(FINAL_RATE ** (iteration / max(self.iterations, 1)))
