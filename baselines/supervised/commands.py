"""The commands that train a network from pairs and export it: files, threads, weights with a data card."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import torch
import tyro
from torch import nn

from baselines.supervised.config import Intervals
from baselines.supervised.training import CURVE, Batches, SupervisedTraining, Validate, train
from baselines.supervised.weights import NetworkFiles, rounded
from baselines.training.checkpoints import CHECKPOINT
from baselines.training.loop import resume
from hydroviews.cli.threads import processors
from hydroviews.errors import InputError
from hydroviews.files.atomic import listing
from hydroviews.files.ownership import require_ours

WEIGHTS = "weights.safetensors"  # of a training, with its data card beside it
OWN_ENTRIES = ("seed", "steps")  # of a configuration, which are entries of the card itself


@dataclass(frozen=True, kw_only=True)
class TrainingRequest(ABC):
    """A training by command, and how it is watched; a network adds what is trained and on what."""

    out: Path  # folder of checkpoint, curve, weights and data card
    intervals: tyro.conf.OmitArgPrefixes[Intervals] = field(default_factory=Intervals)
    threads: int = 0  # 0: one per core
    workers: int | None = None  # processes that draw pairs ahead. Default: none on a CPU; on a GPU one per other core
    validated: int = 0  # held-out photographs of the last validation, 0 for all

    files: ClassVar[NetworkFiles]

    @abstractmethod
    def begin(self) -> SupervisedTraining:
        """The training in its first state."""

    @abstractmethod
    def described(self) -> str:
        """The data in words, for checkpoint and card."""

    @abstractmethod
    def batches(self) -> Batches:
        """What is learned from."""

    @abstractmethod
    def validation(self) -> Validate:
        """How the averaged network is judged while it learns."""

    @abstractmethod
    def judged(self, network: nn.Module) -> tuple[dict[str, Any], str]:
        """Scores of the trained network on held-out photographs: entries of its card, and text to be printed."""


def train_network(request: TrainingRequest) -> None:
    """Train a network, write its weights and data card; an interrupted command resumes when repeated.

    Raises:
        InputError: files of somebody else's in the way, data that cannot be read, or a checkpoint of another training.
    """
    use_threads(request.threads)
    require_own_files(request.out)
    training, data = request.begin(), request.described()
    workers = drawing_workers(training.device.type) if request.workers is None else request.workers
    train(training, request.batches(), request.out, data, request.validation(), request.intervals, workers)
    write_weights(request, training, data)


def export_network(request: TrainingRequest) -> None:
    """Write weights and data card of an unfinished training.

    Raises:
        InputError: nothing was trained there, or its checkpoint is damaged or of another training.
    """
    use_threads(request.threads)
    training, data = request.begin(), request.described()
    resume(training, request.out / CHECKPOINT, training.fingerprint(data))
    if training.iteration == 0:
        raise InputError(f"{request.out}: nothing has been trained there", fix="give the folder of a training")
    write_weights(request, training, data)


def write_weights(request: TrainingRequest, training: SupervisedTraining, data: str) -> None:
    """Judge the averaged network as a file has it; write it, and the card that says in words what it learned from."""
    network, path = training.averaged, request.out / WEIGHTS
    network.load_state_dict(rounded(network.state_dict()))
    validated, text = request.judged(network)
    settings = asdict(training.config)
    settings.pop(request.files.part)
    card = {
        "data": data,
        "seed": training.config.seed,
        "steps": training.iteration,
        "of": training.config.steps,
        "seconds": round(training.seconds),
        "training": {name: value for name, value in settings.items() if name not in OWN_ENTRIES},
        **validated,
    }
    request.files.save(path, network, card)
    print(f"{text}\nwritten: {path}, {path.stat().st_size / 1e6:.1f} MB")


def use_threads(count: int) -> None:
    """Calculate with so many threads; 0 leaves it to torch.

    Raises:
        InputError: a negative number.
    """
    if count < 0:
        raise InputError(f"--threads {count}: impossible", expected="0 or more")
    if count:
        torch.set_num_threads(count)


def drawing_workers(device: str) -> int:
    """How many processes draw pairs ahead: a GPU would wait for them, a processor shares its cores with them."""
    return max(1, processors() - 1) if device == "cuda" else 0


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
