"""Between torch and numpy: modules as named arrays for checkpoints, arrays on the way to a GPU and back; threads."""

from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from hydroviews.cli.threads import AT_ONCE, processors

MOMENTS = ("exp_avg", "exp_avg_sq")
SMALL = 1 << 16  # bytes of an array that pinned memory does not pay for


def module_arrays(module: nn.Module, optimiser: torch.optim.Optimizer | None = None) -> dict[str, NDArray]:
    """Copies of all parameters and buffers by name; with an optimiser of Adam's kind its moments and steps as well."""
    arrays = {f"network.{name}": _array(value) for name, value in module.state_dict().items()}
    if optimiser:
        for name, parameter in module.named_parameters():
            state = optimiser.state.get(parameter, {})
            arrays |= {f"{key}.{name}": _array(state[key]) for key in ("step", *MOMENTS) if state}
    return arrays


def restore_module(
    module: nn.Module, arrays: dict[str, NDArray], optimiser: torch.optim.Optimizer | None = None
) -> None:
    """Take over what `module_arrays` returned, on the device the module is on.

    Raises:
        KeyError: a parameter or buffer is missing.
        RuntimeError: one has another number of elements.
    """
    state = module.state_dict()
    module.load_state_dict({name: _tensor(arrays[f"network.{name}"], value) for name, value in state.items()})
    if optimiser:
        optimiser.state.clear()
        # A fused Adam counts its steps where the parameters are, others on the CPU.
        there = any(group.get("fused") or group.get("capturable") for group in optimiser.param_groups)
        for name, parameter in module.named_parameters():
            if f"exp_avg.{name}" in arrays:
                moments = {key: _tensor(arrays[f"{key}.{name}"], parameter) for key in MOMENTS}
                step = _tensor(arrays[f"step.{name}"], torch.zeros((), device=parameter.device if there else "cpu"))
                optimiser.state[parameter] = {"step": step, **moments}


def _array(value: Tensor) -> NDArray:
    return np.array(value.detach().cpu().numpy(), order="C")


def _tensor(array: NDArray, like: Tensor) -> Tensor:
    """A copy in shape and memory layout of another tensor: files turn single numbers into arrays of one."""
    return torch.empty_like(like).copy_(torch.from_numpy(array).reshape(like.shape))


def sent(values: NDArray[np.float32]) -> Tensor:
    """An array, uploaded without waiting for what the GPU does; it may be written over at once."""
    if values.nbytes <= SMALL:  # the driver takes a copy of it first
        return torch.from_numpy(values).cuda(non_blocking=True)
    return _pinned(values.shape).copy_(torch.from_numpy(values)).cuda(non_blocking=True)


def fetched(values: Tensor) -> NDArray[np.float32]:
    """An array of the GPU's, downloaded."""
    return _pinned(values.shape).copy_(values.detach()).numpy()


def _pinned(shape: Sequence[int]) -> Tensor:
    """Memory of the CPU that the GPU reads and writes itself: copies take a fourth to two fifths of the time.

    Torch keeps it for the next that ask, and does not hand it out while a copy is under way.
    """
    return torch.empty(shape, pin_memory=True)


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Has torch calculate with so many threads while the block lasts, in all threads of the process.

    Numba's threads are started first: as they start, they set the number of OpenMP, which is torch's as well.
    """
    import numba

    numba.get_num_threads()
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def one_thread() -> Iterator[None]:
    """The order in which torch adds up, and so the last bits, depends on the number of threads. Also a decorator."""
    with torch_threads(1):
        yield


def picture_threads() -> AbstractContextManager[None]:
    """While pictures are worked on side by side: each with its share of the processors."""
    return torch_threads(max(1, processors() // AT_ONCE))
