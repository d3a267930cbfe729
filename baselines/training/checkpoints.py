"""Checkpoints: a tree of states in one safetensors file, and what it has to agree with.

A tree is nested dictionaries whose leaves are numpy arrays or plain JSON values, as `state_dict()` gives it. Arrays
are stored under the names on their way, joined by "/" (names of torch's parameters have dots of their own); all other
leaves stand in the file's description. Files are written whole or not at all.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from baselines.training.images import TrainingImages
from hydroviews.errors import InputError, MachineError
from hydroviews.files.atomic import replacing
from hydroviews.scene.scenes import Scene

FORMAT = "hydroviews-splatting-1"
CHECKPOINT = "checkpoint.safetensors"
MODEL = "model.safetensors"  # once it is trained
SEPARATOR = "/"
UNCOUNTED = ("checkpoint_seconds", "device")  # settings with which the result is the same
HEADER = 8  # bytes at the beginning of a safetensors file: how long the description is that follows

Tree = dict[str, Any]  # of dictionaries, numpy arrays and JSON values


def write_arrays(path: Path, arrays: dict[str, NDArray], about: dict[str, Any]) -> None:
    """Write named arrays and a JSON description, whole or not at all."""
    contiguous = {name: np.ascontiguousarray(value) for name, value in arrays.items()}
    with replacing(path) as temporary:
        save_file(contiguous, temporary, {"format": FORMAT, "about": json.dumps(about, sort_keys=True)})


def read_arrays(path: Path) -> tuple[dict[str, NDArray], dict[str, Any]]:
    """What `write_arrays` wrote.

    Raises:
        InputError: missing.
        MachineError: damaged, or written by something else.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        with safe_open(path, "numpy") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a dict)
        about = json.loads(metadata.get("about", "{}"))
    except (SafetensorError, OSError, ValueError) as error:
        raise MachineError(f"{path}: damaged", found=error, fix="remove the file and start again") from None
    if metadata.get("format") != FORMAT:
        raise MachineError(f"{path}: not one of our files", found=metadata.get("format"), expected=FORMAT)
    return arrays, about


def megabytes(path: Path) -> float:
    """Size of the arrays in a file that `write_arrays` wrote, in 10^6 bytes.

    The description is not counted: it tells how long the training took, so that its length may differ.
    """
    with path.open("rb") as file:
        header = int.from_bytes(file.read(HEADER), "little")
    return (path.stat().st_size - HEADER - header) / 1e6


def prefixed(part: str, arrays: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Arrays by the names `part.name`: the state of a part, among the arrays of the whole."""
    return {f"{part}.{name}": value for name, value in arrays.items()}


def below(part: str, arrays: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """The arrays whose names begin with `part.`, without that beginning: what `prefixed` was given."""
    start = f"{part}."
    return {name.removeprefix(start): value for name, value in arrays.items() if name.startswith(start)}


def save_checkpoint(path: Path, tree: Mapping[str, Any], fingerprint: Mapping[str, Any]) -> None:
    """Write a tree of states.

    Args:
        path: the file, replaced when whole.
        tree: nested dictionaries of arrays and JSON values.
        fingerprint: what the state belongs to, for JSON; `load_checkpoint` wants the same.

    Raises:
        ValueError: a name that is not text, is empty or has a "/".
        TypeError: a leaf that is neither an array nor a JSON value.
    """
    leaves = dict(_leaves(tree))
    arrays = {name: leaf for name, leaf in leaves.items() if isinstance(leaf, np.ndarray)}
    values = {name: leaf for name, leaf in leaves.items() if name not in arrays}
    write_arrays(path, arrays, {"fingerprint": fingerprint, "values": values})


def load_checkpoint(path: Path, fingerprint: Mapping[str, Any]) -> Tree:
    """The tree that `save_checkpoint` wrote; tuples come back as lists, arrays without axes with one of length 1.

    Raises:
        InputError: missing, or of another configuration, seed or scene.
        MachineError: damaged, or of another version.
    """
    arrays, about = read_arrays(path)
    check_fingerprint(path, about.get("fingerprint", {}), dict(fingerprint))
    if "values" not in about:
        raise MachineError(f"{path}: a checkpoint of another version", fix="remove the file and start again")
    tree: Tree = {}
    for name, leaf in {**arrays, **about["values"]}.items():
        *way, last = name.split(SEPARATOR)
        branch = tree
        for part in way:
            branch = branch.setdefault(part, {})
        branch[last] = leaf
    return tree


def _leaves(tree: Mapping[str, Any], start: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves by the names on the way to them; an empty dictionary is a leaf."""
    for name, value in tree.items():
        if not isinstance(name, str) or not name or SEPARATOR in name:
            raise ValueError(f"state {start}{name!r}: expected a name without {SEPARATOR}")
        if isinstance(value, Mapping) and value:
            yield from _leaves(value, f"{start}{name}{SEPARATOR}")
        else:
            yield start + name, value


def settings_of(config: Any, **others: Any) -> dict[str, Any]:
    """All settings of a dataclass, and of those in it, that would lead to another result, and others; for JSON."""
    counted = asdict(config, dict_factory=lambda items: {name: value for name, value in items if name not in UNCOUNTED})
    return counted | others


def fingerprint_of(
    settings: Mapping[str, Any], seed: int, scene: Scene, images: TrainingImages, **others: Any
) -> dict[str, Any]:
    """What a checkpoint must agree with: anything that would lead to another result.

    Args:
        settings: of the whole method; see `settings_of`.
        seed: of everything random.
        scene: its training cameras and points count.
        images: that are learned from.
        others: whatever else counts, for JSON.
    """
    digest = hashlib.sha256()
    for view in scene.train_views:
        camera = view.camera
        numbers = [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy]
        digest.update(json.dumps([view.name, numbers]).encode() + camera.world_to_camera.tobytes())
    digest.update(np.ascontiguousarray(scene.points.positions, np.float64).tobytes())
    digest.update(np.ascontiguousarray(scene.points.colours).tobytes())
    return {
        "configuration": dict(settings),
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
