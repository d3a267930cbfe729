"""Where drops are, looked for again and again: residual blocks, a convolutional LSTM and a map, N times over."""

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

START = 0.5  # of the map that the first look is given
DRY = -2.0  # logit of a map before anything is learned: about the share of drops
SHRUNK = 0.5  # of a residual block's second convolution at the start, so that features do not grow from block to block
State = tuple[Tensor, Tensor]  # hidden and cell [N, C, H, W]


class ResidualBlock(nn.Module):
    """relu(x + relu(conv(relu(conv(x)))))."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(width, width, 3, padding=1)
        self.second = nn.Conv2d(width, width, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        """Of features [N, C, H, W]."""
        return functional.relu(x + functional.relu(self.second(functional.relu(self.first(x)))))


class ConvLSTM(nn.Module):
    """A long short-term memory at every pixel, its products convolutions (Shi et al. 2015, without peepholes)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.width = width
        self.gates = nn.Conv2d(2 * width, 4 * width, 3, padding=1)  # input, forget, candidate, output

    def forward(self, x: Tensor, state: State) -> State:
        """One step: c = f c + i g, h = o tanh(c).

        Args:
            x: [N, C, H, W].
            state: hidden and cell before the step, of the same shape.
        """
        hidden, cell = state
        i, f, g, o = self.gates(torch.cat([x, hidden.to(x.dtype)], dim=1)).float().chunk(4, dim=1)
        cell = torch.sigmoid(f) * cell + torch.sigmoid(i) * torch.tanh(g)
        return torch.sigmoid(o) * torch.tanh(cell), cell

    def start(self, x: Tensor) -> State:
        """Nothing is remembered yet."""
        nothing = torch.zeros_like(x, dtype=torch.float32)
        return nothing, nothing


class RecurrentAttention(nn.Module):
    """Attention maps, each found from the picture, the map before it and what is remembered of earlier looks."""

    def __init__(self, iterations: int, width: int, blocks: int, stride: int) -> None:
        super().__init__()
        self.iterations, self.stride = iterations, stride
        self.start = nn.Conv2d(3 * stride * stride + 1, width, 3, padding=1)
        residual_blocks = [ResidualBlock(width) for _ in range(blocks)]
        self.blocks = nn.Sequential(*residual_blocks)
        self.memory = ConvLSTM(width)
        self.map = nn.Conv2d(width, 1, 3, padding=1)
        self._begin(residual_blocks)

    def _begin(self, blocks: Sequence[ResidualBlock]) -> None:
        """Random weights that hand on what they are given (He et al. 2015): a memory that hardly sees learns late."""
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d):
                nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
                nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
        with torch.no_grad():
            for block in blocks:
                block.second.weight.mul_(SHRUNK)
            self.map.bias.fill_(DRY)  # type: ignore[union-attr]

    def forward(self, picture: Tensor) -> tuple[Tensor, ...]:
        """N maps [B, 1, H / stride, W / stride] in (0, 1), each found with the same weights.

        Of pictures [B, 3, H, W] in [-1, 1], height and width multiples of the stride.
        """
        squares = functional.pixel_unshuffle(picture, self.stride)
        attention = torch.full_like(squares[:, :1], START)
        state: State | None = None
        maps = []
        for _ in range(self.iterations):
            features = self.blocks(functional.relu(self.start(torch.cat([squares, attention], dim=1))))
            state = self.memory(features, state or self.memory.start(features))
            attention = torch.sigmoid(self.map(state[0]).float())
            maps.append(attention)
        return tuple(maps)
