"""Training states and trained models on disk, as safetensors."""

from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from baselines.splatting.gaussians import FEATURES, FIELDS, Gaussians
from baselines.splatting.state import TrainingState
from baselines.training.checkpoints import check_fingerprint, read_arrays, write_arrays
from hydroviews.errors import InputError

PARTS = ("gaussians", "first", "second")
PROGRESS = ("iteration", "seconds", "residuals", "non_finite")


def write_checkpoint(path: Path, state: TrainingState, learnt: dict[str, NDArray], fingerprint: dict[str, Any]) -> None:
    """Write a training state.

    Args:
        path: the file, replaced when whole.
        state: all of it is written.
        learnt: what the objective has learnt.
        fingerprint: of configuration, seed and scene; must be the same when read.
    """
    arrays = {f"{part}.{name}": value for part in PARTS for name, value in getattr(state, part).state_dict().items()}
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


def write_model(path: Path, gaussians: Gaussians, about: dict[str, Any]) -> None:
    """Write trained Gaussians exactly, with a description."""
    write_arrays(path, {**gaussians.state_dict(), "origin": gaussians.origin}, about)


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
