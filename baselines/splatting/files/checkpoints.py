"""Training states as trees for checkpoints, and trained models on disk, as safetensors."""

from pathlib import Path
from typing import Any

from baselines.splatting.files.finite import require_finite
from baselines.splatting.gaussians import FEATURES, FIELDS, Gaussians
from baselines.splatting.state import TrainingState
from baselines.training.checkpoints import Tree, read_arrays, write_arrays
from hydroviews.errors import InputError

FIX = "train the method again"
PARTS = ("gaussians", "first", "second")
OTHERS = ("gradient_sum", "seen", "iteration", "seconds", "residuals", "non_finite")


def state_to_tree(state: TrainingState) -> Tree:
    """All of a training state: the arrays themselves, not copies of them."""
    parts = {part: getattr(state, part).state_dict() for part in PARTS}
    return {**parts, "origin": state.gaussians.origin, **{name: getattr(state, name) for name in OTHERS}}


def state_from_tree(tree: Tree) -> TrainingState:
    """The opposite.

    Raises:
        KeyError: a part is missing.
    """
    names = (*FIELDS, FEATURES) if FEATURES in tree["gaussians"] else FIELDS
    gaussians, first, second = (
        Gaussians(**{name: tree[part][name] for name in names}, origin=tree["origin"]) for part in PARTS
    )
    others = {**{name: tree[name] for name in OTHERS}, "residuals": tuple(tree["residuals"])}
    return TrainingState(gaussians, first, second, **others)


def write_model(path: Path, gaussians: Gaussians, about: dict[str, Any]) -> None:
    """Write trained Gaussians exactly, with a description."""
    write_arrays(path, {**gaussians.state_dict(), "origin": gaussians.origin}, about)


def read_model(path: Path) -> tuple[Gaussians, dict[str, Any]]:
    """What `write_model` wrote.

    Raises:
        InputError: missing or damaged, not a model, or Gaussians that are not finite.
    """
    arrays, about = read_arrays(path)
    missing = [name for name in (*FIELDS, "origin") if name not in arrays]
    if missing:
        raise InputError(f"{path}: not a model", found=f"no {', '.join(missing)}", fix=FIX)
    try:
        gaussians = Gaussians(**arrays)
    except (TypeError, ValueError) as error:  # an array of another name, shape or kind
        raise InputError(f"{path}: not a model", found=error, fix=FIX) from error
    return require_finite(path, gaussians, FIX), about
