"""What commands of networks trained from pairs share: threads, photographs described, trainings to export, weights."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from baselines.training.checkpoints import CHECKPOINT
from baselines.training.loop import resume
from baselines.training.supervised_training import CURVE, SupervisedTraining
from hydroviews.errors import InputError
from hydroviews.files.atomic import listing
from hydroviews.files.ownership import require_ours

WEIGHTS = "weights.safetensors"  # of a training, with its data card beside it


def use_threads(count: int) -> None:
    """Calculate with so many threads; 0 leaves it to torch.

    Raises:
        InputError: a negative number.
    """
    if count < 0:
        raise InputError(f"--threads {count}: impossible", expected="0 or more")
    if count:
        torch.set_num_threads(count)


def require_own_files(folder: Path) -> None:
    """Refuse a folder for a new training in which somebody else's files have the names of checkpoint, curve or weights.

    A checkpoint says itself whether it is of this training.

    Raises:
        InputError: there are such files.
    """
    if not (folder / CHECKPOINT).exists():
        require_ours([folder / CURVE, folder / WEIGHTS, (folder / WEIGHTS).with_suffix(".json")])


def in_words(photographs: Sequence[Path], folder: Path) -> str:
    """What is learned from: how many photographs, of which folder, and their `listing`."""
    return f"{len(photographs)} photographs ({folder.parent.name}/{folder.name}, {listing(photographs)})"


def load_trained(training: SupervisedTraining, folder: Path, fingerprint: Mapping[str, Any]) -> None:
    """Bring a new training to where the checkpoint in `folder` stands.

    Raises:
        InputError: there is none, or it is damaged or of another training.
    """
    resume(training, folder / CHECKPOINT, fingerprint)
    if training.iteration == 0:
        raise InputError(f"{folder}: nothing has been trained there", fix="give the folder of a training")


def rounded(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Weights as they come back from a file of half floats."""
    return {name: value.half().float() for name, value in tensors.items()}


def weights_file(weights: str | Path, shipped: Path, what: str) -> Path:
    """The file of the named weights in the folder `shipped`, or the file itself.

    Args:
        weights: name or path.
        shipped: where named ones are.
        what: kind of network, for the error.

    Raises:
        InputError: none of that name are there.
    """
    if Path(weights).suffix:
        return Path(weights)
    path = shipped / f"{weights}.safetensors"
    if not path.is_file():
        names = ", ".join(sorted(file.stem for file in shipped.glob("*.safetensors")))
        raise InputError(
            f"{what} weights {weights}: none of that name are shipped",
            expected=f"one of: {names or 'none'}; or the path of a .safetensors file",
        )
    return path
