"""All kernels of the rain model at once: compiled where they are not yet, and loaded before a training's clock runs."""

from functools import cache
from pathlib import Path

from baselines.splatting.backends.warm_up import compile_apart
from deraings.rain_model import drops_kernels, layer_kernels, mist_kernels, rain_kernels

HERE = Path(__file__).parent


@cache
def warm_up() -> None:
    """Load the kernels, once a process; see `compile_apart`."""
    compile_apart("rain", f"from {__name__} import exercise_kernels; exercise_kernels()", HERE.glob("*_kernels.py"))
    exercise_kernels()


def exercise_kernels() -> None:
    """Call every kernel."""
    for module in (drops_kernels, layer_kernels, mist_kernels, rain_kernels):
        module.exercise_kernels()
