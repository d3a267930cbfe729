"""Training states and trained models on disk, as safetensors."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from baselines.splatting.config import TrainerConfig
from baselines.splatting.gaussians import FEATURES, FIELDS, Gaussians
from baselines.splatting.objective import Objective
from baselines.splatting.state import TrainingState
from hydroviews.errors import InputError
from hydroviews.files import replacing
from hydroviews.scenes import Scene

FORMAT = "hydroviews-splatting-1"
PARTS = ("gaussians", "first", "second")
PROGRESS = ("iteration", "seconds", "residuals", "broken")


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


def write_checkpoint(path: Path, state: TrainingState, learnt: dict[str, NDArray], fingerprint: dict[str, Any]) -> None:
    """Write a training state.

    Args:
        path: the file, replaced when whole.
        state: all of it is written.
        learnt: what the objective has learnt.
        fingerprint: of configuration, seed and scene; must be the same when read.
    """
    arrays = {f"{part}.{name}": value for part in PARTS for name, value in getattr(state, part).arrays().items()}
    arrays |= {"gradient_sum": state.gradient_sum, "seen": state.seen, "origin": state.gaussians.origin}
    arrays |= {f"learnt.{name}": value for name, value in learnt.items()}
    progress = {name: getattr(state, name) for name in PROGRESS}
    write_arrays(path, arrays, {"fingerprint": fingerprint, "progress": progress})


def read_checkpoint(path: Path, fingerprint: dict[str, Any]) -> tuple[TrainingState, dict[str, NDArray]]:
    """The state and what the objective had learnt.

    Raises:
        InputError: damaged, or of another configuration, seed or scene.
    """
    arrays, about = read_arrays(path)
    check_fingerprint(path, about.get("fingerprint", {}), fingerprint)
    origin = arrays["origin"]
    names = (*FIELDS, FEATURES) if f"gaussians.{FEATURES}" in arrays else FIELDS
    gaussians, first, second = (
        Gaussians(**{name: arrays[f"{part}.{name}"] for name in names}, origin=origin) for part in PARTS
    )
    learnt = {name.removeprefix("learnt."): v for name, v in arrays.items() if name.startswith("learnt.")}
    statistics = arrays["gradient_sum"], arrays["seen"]
    progress = {**about["progress"], "residuals": tuple(about["progress"]["residuals"])}
    return TrainingState(gaussians, first, second, *statistics, **progress), learnt


def fingerprint_of(config: TrainerConfig, seed: int, scene: Scene, objective: Objective) -> dict[str, Any]:
    """What a checkpoint must agree with: anything that would lead to another result."""
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
        "objective": objective.about(),
        "seed": seed,
        "cameras or points": digest.hexdigest(),
        "images": objective.images.digest(),
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


def write_model(path: Path, gaussians: Gaussians, about: dict[str, Any]) -> None:
    """Write trained Gaussians exactly, with a description."""
    write_arrays(path, {**gaussians.arrays(), "origin": gaussians.origin}, about)


def read_model(path: Path) -> tuple[Gaussians, dict[str, Any]]:
    """What `write_model` wrote.

    Raises:
        InputError: missing or damaged, or not a model.
    """
    arrays, about = read_arrays(path)
    missing = [name for name in (*FIELDS, "origin") if name not in arrays]
    if missing:
        raise InputError(f"{path}: not a model", found=f"no {', '.join(missing)}", fix="train the method again")
    return Gaussians(**arrays), about
