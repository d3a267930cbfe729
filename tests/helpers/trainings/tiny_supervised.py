"""A network of one convolution that learns to darken pictures, for tests of the training of networks from pairs."""

from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from torch import Tensor, nn

from baselines.supervised.config import Intervals, SupervisedConfig
from baselines.supervised.training import Learner, SupervisedTraining, train

INTERVALS = Intervals(checkpoint_seconds=0.0, validate_every=3)


@dataclass(frozen=True)
class LayerConfig:
    size: int = 3
    stretch: tuple[int, int] = (1, 1)


@dataclass(frozen=True, kw_only=True)
class ToyConfig(SupervisedConfig):
    network: LayerConfig = field(default_factory=LayerConfig)


CONFIG = ToyConfig(steps=6, batch=2, patch=8, rate=1e-2, warm_up=2)


class Toy(nn.Module):
    def __init__(self, config: LayerConfig) -> None:
        super().__init__()
        self.config = config
        self.layer = nn.Conv2d(3, 3, config.size, padding=config.size // 2)

    def forward(self, picture: Tensor) -> Tensor:
        return self.layer(picture)


class Sample(NamedTuple):
    rainy: Tensor
    clean: Tensor


class ToyTraining(SupervisedTraining):
    def __init__(self, config: ToyConfig) -> None:
        torch.manual_seed(config.seed)
        network = Toy(config.network)
        super().__init__(config, {"network": Learner(network, torch.optim.Adam(network.parameters(), config.rate))})

    def _learn(self, batch: Sample) -> dict[str, Tensor]:
        with self._autocast():
            found = self._first(batch.rainy)
        loss = (found.float() - batch.clean).square().mean()
        self._descend("network", loss)
        return {"loss": loss}


class Darker:
    """Batches of noise, and the same darker; `until` a step at which somebody presses Ctrl-C."""

    def __init__(self, config: ToyConfig, until: int | None = None) -> None:
        self.config, self.until = config, until

    def __getitem__(self, step: int) -> Sample:
        if step == self.until:
            raise KeyboardInterrupt
        generator = torch.Generator().manual_seed(1000 * self.config.seed + step)
        rainy = torch.rand(self.config.batch, 3, self.config.patch, self.config.patch, generator=generator)
        return Sample(rainy, 0.5 * rainy)


def learn(folder, config=CONFIG, until=None, data="darker", workers=0, intervals=INTERVALS) -> ToyTraining:
    training, scores = ToyTraining(config), iter(range(100))
    validate = lambda _: {"score": float(next(scores))}  # noqa: E731
    train(training, Darker(config, until), folder, data, validate, intervals, workers)
    return training


def weights_of(training: SupervisedTraining) -> Tensor:
    """All that was learned: of the averaged network, and of those that learn."""
    networks = [training.averaged, *(learner.network for learner in training.learners.values())]
    return torch.cat([parameter.detach().flatten() for network in networks for parameter in network.parameters()])
