"""PlayCanvas' compressed .ply, decoded plainly from its description, with nothing of the library that writes it."""

from pathlib import Path

import numpy as np
from plyfile import PlyData

from baselines.splatting.gaussians import Gaussians
from baselines.splatting.kernels.splats.sh_coefficients import from_colour

RUN = 256  # Gaussians that share bounds


def read_compressed_ply(path: Path) -> Gaussians:
    data = PlyData.read(str(path))
    packed, runs = data["vertex"].data, data["chunk"].data[np.arange(data["vertex"].count) // RUN]
    parts = {name: packed[f"packed_{name}"].astype(np.uint32) for name in ("position", "rotation", "scale", "color")}
    colours = between(runs, "rgb", [bits(parts["color"], at, 8) for at in (24, 16, 8)], "")
    opacities = np.clip(bits(parts["color"], 0, 8), 1e-6, 1 - 1e-6)
    higher = np.zeros((len(packed), 0, 3))
    if "sh" in data:
        whole = np.stack([data["sh"].data[p.name] for p in data["sh"].properties], axis=1).astype(float)
        centred = np.select([whole == 0, whole == 255], [0, 1], (whole + 0.5) / 256)
        higher = ((centred - 0.5) * 8).reshape(len(packed), 3, -1).transpose(0, 2, 1)
    values = {
        "means": between(runs, "xyz", thirds(parts["position"]), ""),
        "quaternions": rotations(parts["rotation"]),
        "log_scales": between(runs, "xyz", thirds(parts["scale"]), "scale_"),
        "opacity_logits": np.log(opacities / (1 - opacities)),
        "sh": np.concatenate([from_colour(colours)[:, None], higher], axis=1),
    }
    return Gaussians(**{name: np.ascontiguousarray(value, np.float32) for name, value in values.items()})


def bits(words: np.ndarray, at: int, n: int) -> np.ndarray:
    return ((words >> at) & (2**n - 1)) / (2**n - 1)


def thirds(words: np.ndarray) -> list[np.ndarray]:
    return [bits(words, 21, 11), bits(words, 11, 10), bits(words, 0, 11)]


def between(runs: np.ndarray, axes: str, shares: list[np.ndarray], what: str) -> np.ndarray:
    low = np.stack([runs[f"min_{what}{axis}"] for axis in axes], axis=1).astype(float)
    high = np.stack([runs[f"max_{what}{axis}"] for axis in axes], axis=1).astype(float)
    return low + np.stack(shares, axis=1) * (high - low)


def rotations(words: np.ndarray) -> np.ndarray:
    """The largest of w, x, y, z is left out, and follows from the length; the others lie within half a root of two."""
    others = np.stack([(bits(words, at, 10) - 0.5) * np.sqrt(2) for at in (20, 10, 0)], axis=1)
    largest = np.sqrt(np.maximum(1 - (others**2).sum(axis=1), 0))
    return np.stack([np.insert(row, k, value) for row, k, value in zip(others, words >> 30, largest, strict=True)])
