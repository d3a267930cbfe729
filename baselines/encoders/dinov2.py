"""DINOv2's ViT-S/14 with registers (Oquab et al. 2023, Darcet et al. 2024), up to the block whose features are used.

A picture's tokens x are a class token, four registers, and a linear embedding of each patch of 14x14 pixels. A position
embedding is added to all but the registers. Then, once a block (Dosovitskiy et al. 2021, with Touvron et al. 2021's
scales gamma),

    x <- x + gamma_1 attention(norm_1(x)),      x <- x + gamma_2 mlp(norm_2(x))

The network is written here, under the names of the published weights. Nothing that is fetched is run: the weights are
one file of numbers, whose SHA-256 is compared before it is opened, and which is read without unpickling objects.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.functional import gelu, interpolate, scaled_dot_product_attention

from hydroviews.errors import InputError
from hydroviews.files.atomic import sha256
from hydroviews.files.cache import cache_folder
from hydroviews.files.http_download import fetch
from hydroviews.files.locks import locked

WEIGHTS = "HYDROVIEWS_DINOV2"  # environment variable: the weights' file, where it is not to be fetched
URL = "https://dl.fbaipublicfiles.com/dinov2/dinov2_vits14/dinov2_vits14_reg4_pretrain.pth"
SHA256 = "f433177089a681826f849f194ece3bb48f4d63fb38d32fc837e3dc7a4e5641fb"  # of 88,291,785 bytes
PATCH = 14  # pixels
WIDTH, HEADS, REGISTERS, GRID = 384, 6, 4, 37  # there are position embeddings for 37x37 patches
DEPTH = 6  # of its twelve blocks: WildGaussians looks at what the sixth gives
ANOTHER = "or take another network: wild-gaussians with HYDROVIEWS_FEATURES=alexnet, other methods in demo or standard"


class VisionTransformer(nn.Module):
    """The first blocks of a DINOv2 network."""

    def __init__(
        self, width: int = WIDTH, heads: int = HEADS, depth: int = DEPTH, registers: int = REGISTERS, grid: int = GRID
    ) -> None:
        super().__init__()
        self.grid = grid
        self.cls_token = nn.Parameter(torch.zeros(1, 1, width))
        self.register_tokens = nn.Parameter(torch.zeros(1, registers, width))
        self.pos_embed = nn.Parameter(torch.zeros(1, 1 + grid * grid, width))
        self.patch_embed = nn.ModuleDict({"proj": nn.Conv2d(3, width, PATCH, PATCH)})
        self.blocks = nn.ModuleList(Block(width, heads) for _ in range(depth))
        self.norm = nn.LayerNorm(width, eps=1e-6)

    def forward(self, image: Tensor) -> Tensor:
        """Features [width, h, w] of a standardised image [3, 14 h, 14 w], one position for a patch."""
        patches = self.patch_embed["proj"](image)
        height, width = patches.shape[1:]
        x = torch.cat([self.cls_token[0], patches.flatten(1).T]) + self.positions(height, width)
        x = torch.cat([x[:1], self.register_tokens[0], x[1:]])
        for block in self.blocks:
            x = block(x)
        return self.norm(x)[-height * width :].T.unflatten(1, (height, width))

    def positions(self, height: int, width: int) -> Tensor:
        """Position embeddings [1 + h w, width]: the class token's, and the patches' resized to their number."""
        if height == width == self.grid:
            return self.pos_embed[0]
        square = self.pos_embed[:, 1:].unflatten(1, (self.grid, self.grid)).permute(0, 3, 1, 2)
        resized = interpolate(square, size=(height, width), mode="bicubic", antialias=True)
        return torch.cat([self.pos_embed[0, :1], resized[0].flatten(1).T])


class Block(nn.Module):
    """Attention between all tokens [n, width], then two layers on each."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.norm1, self.norm2 = nn.LayerNorm(width, eps=1e-6), nn.LayerNorm(width, eps=1e-6)
        self.attn = Attention(width, heads)
        self.mlp = nn.ModuleDict({"fc1": nn.Linear(width, 4 * width), "fc2": nn.Linear(4 * width, width)})
        self.ls1, self.ls2 = (nn.ParameterDict({"gamma": torch.ones(width)}) for _ in range(2))

    def forward(self, x: Tensor) -> Tensor:
        """[n, width] to the same."""
        x = x + self.ls1["gamma"] * self.attn(self.norm1(x))
        return x + self.ls2["gamma"] * self.mlp["fc2"](gelu(self.mlp["fc1"](self.norm2(x))))


class Attention(nn.Module):
    """softmax(q k^T / sqrt(d)) v of several heads (Vaswani et al. 2017)."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.qkv, self.proj = nn.Linear(width, 3 * width), nn.Linear(width, width)

    def forward(self, x: Tensor) -> Tensor:
        """[n, width] to the same."""
        queries, keys, values = self.qkv(x).unflatten(1, (3, self.heads, -1)).permute(1, 2, 0, 3)
        found: Tensor = self.proj(scaled_dot_product_attention(queries, keys, values).transpose(0, 1).flatten(1))
        return found


def load_dinov2(device: torch.device) -> VisionTransformer:
    """The network with the published weights, on a device; they are fetched once, 88 MB.

    Raises:
        InputError: the weights can neither be found nor fetched, are not the published ones, or do not fit the device.
    """
    path = weights_file()
    found = sha256(path)
    if found != SHA256:
        raise InputError(f"{path}: not DINOv2's weights", found=found, expected=SHA256, fix=f"delete it, or get {URL}")
    with memory_of(device):
        return with_weights(VisionTransformer(), path).to(device)


def weights_file() -> Path:
    """Where the weights are: $HYDROVIEWS_DINOV2, or the cache folder, to which they are fetched.

    Raises:
        InputError: no such file, or no server that delivers it.
    """
    if named := os.environ.get(WEIGHTS):
        if not Path(named).is_file():
            raise InputError(f"{named}: no such file", expected="weights of DINOv2", fix=f"correct {WEIGHTS}")
        return Path(named)
    path = cache_folder() / URL.rpartition("/")[2]
    with locked(path, "another process fetches DINOv2's weights; waiting"):
        if not path.is_file():
            try:
                fetch([URL], path, SHA256)
            except InputError as error:
                fix = f"connect once; or get the file elsewhere and name it with {WEIGHTS}=FILE; {ANOTHER}"
                raise InputError("DINOv2's weights cannot be had", found=error, fix=fix) from error
    return path


def with_weights(network: VisionTransformer, path: Path) -> VisionTransformer:
    """The network with the weights of a file, ready to be used; blocks that it does not have are passed over."""
    state = torch.load(path, map_location="cpu", weights_only=True)
    network.load_state_dict({name: state[name] for name in network.state_dict()})
    return network.requires_grad_(False).eval()


@contextmanager
def memory_of(device: torch.device) -> Iterator[None]:
    """Turn a lack of the device's memory into an error that says what to do.

    Raises:
        InputError: there is not enough.
    """
    try:
        yield
    except torch.OutOfMemoryError as error:
        raise InputError(
            f"DINOv2 does not fit the memory of {device}",
            found=str(error).partition("\n")[0],
            fix=f"end what else uses it; {ANOTHER}",
        ) from error
