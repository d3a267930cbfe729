"""Arrays with a description on disk, as safetensors, and what a checkpoint has to agree with."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from baselines.training.images import TrainingImages
from hydroviews.errors import InputError
from hydroviews.files.atomic import replacing
from hydroviews.scene.scenes import Scene

FORMAT = "hydroviews-splatting-1"


def write_arrays(path: Path, arrays: dict[str, NDArray], about: dict[str, Any]) -> None:
    """Write named arrays and a JSON description, whole or not at all."""
    contiguous = {name: np.ascontiguousarray(value) for name, value in arrays.items()}
    with replacing(path) as temporary:
        save_file(contiguous, temporary, {"format": FORMAT, "about": json.dumps(about, sort_keys=True)})


def read_arrays(path: Path) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """What `write_arrays` wrote.

    Raises:
        InputError: missing, damaged, or written by something else.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        with safe_open(path, "numpy") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a dict)
    except (SafetensorError, OSError, ValueError) as error:
        raise InputError(f"{path}: damaged", found=error, fix="remove the file and start again") from error
    if metadata.get("format") != FORMAT:
        raise InputError(f"{path}: not one of our files", found=metadata.get("format"), expected=FORMAT)
    return arrays, json.loads(metadata["about"])


def fingerprint_of(config: Any, seed: int, scene: Scene, images: TrainingImages, **others: Any) -> dict[str, Any]:
    """What a checkpoint must agree with: anything that would lead to another result.

    Args:
        config: dataclass of settings, among them `checkpoint_seconds` and `device`, which are left out.
        seed: of everything random.
        scene: its training cameras and points count.
        images: that are learned from.
        others: whatever else counts, for JSON.
    """
    settings = asdict(config)
    for name in ("checkpoint_seconds", "device"):
        del settings[name]
    digest = hashlib.sha256()
    for view in scene.train_views:
        camera = view.camera
        numbers = [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy]
        digest.update(json.dumps([view.name, numbers]).encode() + camera.world_to_camera.tobytes())
    digest.update(np.ascontiguousarray(scene.points.positions, np.float64).tobytes())
    digest.update(np.ascontiguousarray(scene.points.colours).tobytes())
    return {
        "configuration": settings,
        "seed": seed,
        "cameras or points": digest.hexdigest(),
        "images": images.digest(),
        **others,
    }


def check_fingerprint(path: Path, found: dict[str, Any], expected: dict[str, Any]) -> None:
    """Refuse a checkpoint of another run.

    Args:
        path: the checkpoint.
        found: its fingerprint.
        expected: that of this run.

    Raises:
        InputError: they differ; it says in what.
    """
    expected = json.loads(json.dumps(expected))
    different = [name for name in sorted({*found, *expected}) if found.get(name) != expected.get(name)]
    if different:
        name = different[0]
        raise InputError(
            f"{path}: the checkpoint is of another run, with a different {', '.join(different)}",
            found=_difference(found.get(name), expected.get(name)),
            expected=_difference(expected.get(name), found.get(name)),
            fix="use another folder for the new run, or remove the checkpoint to start again",
        )


def _difference(value: Any, other: Any) -> Any:
    if isinstance(value, dict) and isinstance(other, dict):
        return {key: item for key, item in value.items() if other.get(key) != item} or "nothing else"
    return value
