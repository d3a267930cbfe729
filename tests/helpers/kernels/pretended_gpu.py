"""A GPU that is none: every tensor knows where it would be, and what a GPU would refuse or wait for is noticed.

Numbers are calculated on the CPU. Storages that `.cuda()`, `.to("cuda")` or `device="cuda"` make are marked, and so is
what is calculated from them. Mixing them with others is an error, as is `.numpy()` of one.
"""

import contextlib
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import torch
from gsplat_module import compiled_module
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode, _disable_current_modes
from torch.utils._pytree import tree_leaves

NAME = "pretended GPU"
THERE = torch.device("cuda", 0)
aten = torch.ops.aten
# What the CPU asks and has to wait for. Finding by a mask is a question, too.
QUESTIONS = {aten._local_scalar_dense.default, aten.nonzero.default, aten.masked_select.default, aten.equal.default}
FINDING = {aten.index.Tensor, aten.index_put.default, aten.index_put_.default, aten._index_put_impl_.default}


def on_gpu(tensor: Tensor) -> bool:
    """Whether a tensor would be in the GPU's memory."""
    return getattr(tensor.untyped_storage(), "on_gpu", False)


def place(value: Any, there: bool = True) -> Any:
    """Say of all tensors of a value where they are; the value."""
    for tensor in tree_leaves(value):
        if isinstance(tensor, Tensor):
            tensor.untyped_storage().on_gpu = there  # type: ignore[attr-defined]
    return value


class PretendedGPU:
    """What a program asks of the GPU, counted since `counts` was last cleared."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()  # uploads, downloads, questions and kernels
        self._moves = _Moves(self.counts)
        self._engine = torch.autograd._engine_run_backward

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """While it lasts there is a GPU."""
        with self._moves, _Places(self.counts):
            yield

    def run_backward(self, *args: Any, **kwargs: Any) -> Any:
        """What autograd's engine does; `backward` has switched the function mode off."""
        with self._moves:
            return self._engine(*args, **kwargs)

    def launch(self, kernel: Callable, *arguments: Any) -> Any:
        """Run a kernel: what happens in it is its own business, what comes out is on the GPU."""
        self.counts["kernels"] += 1
        with torch._C.DisableTorchFunction(), _disable_current_modes():
            return place(kernel(*arguments))


class _Places(TorchDispatchMode):
    """Looks at every operator: are its tensors in one place, and does the CPU wait for its answer?"""

    def __init__(self, counts: Counter[str]) -> None:
        super().__init__()
        self.counts = counts

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        tensors = [value for value in tree_leaves((args, kwargs)) if isinstance(value, Tensor)]
        there = [tensor for tensor in tensors if on_gpu(tensor)]
        here = [tensor for tensor in tensors if tensor.ndim and not on_gpu(tensor)]
        if there and here:
            self._cross(function, args, there, here)
        out = function(*args, **(kwargs or {}))
        if not there or function is aten.copy_.default:
            return out
        if function in QUESTIONS or (function in FINDING and any(t.dtype == torch.bool for t in there)):
            self.counts["questions"] += 1
        return place(out)

    def _cross(self, function: Any, args: Any, there: list[Tensor], here: list[Tensor]) -> None:
        """What may have tensors of both places: a copy, and indices, which are uploaded behind one's back."""
        if function is aten.copy_.default:
            self.counts["uploads" if on_gpu(args[0]) else "downloads"] += 1
        elif function in FINDING and on_gpu(args[0]):
            self.counts["uploads"] += len(here)
        elif function not in (aten.set_.source_Storage, aten.set_.source_Tensor):
            shapes = [[tuple(tensor.shape) for tensor in tensors] for tensors in (there, here)]
            raise RuntimeError(
                f"Expected all tensors to be on the same device: {function}, cuda:0 {shapes[0]}, cpu {shapes[1]}"
            )


class _Moves(TorchFunctionMode):
    """Stands in for what asks where a tensor is, makes it there, or moves it."""

    def __init__(self, counts: Counter[str]) -> None:
        super().__init__()
        self.counts = counts
        self.instead: dict[Any, Callable[..., Any]] = {
            Tensor.device.__get__: lambda tensor, *_: THERE if on_gpu(tensor) else torch.device("cpu"),
            Tensor.is_cuda.__get__: lambda tensor, *_: on_gpu(tensor),
            Tensor.is_cpu.__get__: lambda tensor, *_: not on_gpu(tensor),
            Tensor.cuda: lambda tensor, *_, **__: self._moved(tensor, True),
            Tensor.cpu: lambda tensor, *_, **__: self._moved(tensor, False),
            Tensor.to: self._to,
            Tensor.tolist: lambda tensor: self._moved(tensor.detach(), False).tolist(),
            Tensor.new_tensor: self._new_tensor,
        }

    def __torch_function__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        kwargs.pop("pin_memory", None)  # there is no driver to ask for it
        if function in self.instead:
            return self.instead[function](*args, **kwargs)
        if function in (Tensor.numpy, Tensor.__array__) and on_gpu(args[0]):
            raise TypeError("can't convert cuda:0 device type tensor to numpy. Use Tensor.cpu() first.")
        if function is torch.nn.functional.embedding_bag and on_gpu(args[0]):
            with _disable_current_modes():  # its offsets are made in a place that only it knows
                return place(function(*args, **kwargs))
        if _is_cuda(kwargs.get("device")):
            given = kwargs.get("generator")
            if given is not None and not given.there:
                raise RuntimeError("Expected a 'cuda' device type for generator but found 'cpu'")
            self.counts["uploads"] += function in (torch.tensor, torch.as_tensor)
            return place(function(*args, **{**kwargs, "device": "cpu"}))
        return function(*args, **kwargs)

    def _to(self, tensor: Tensor, *args: Any, **kwargs: Any) -> Tensor:
        if args and isinstance(args[0], Tensor):
            there, dtype = on_gpu(args[0]), args[0].dtype
        else:
            device, dtype, *_ = torch._C._nn._parse_to(*args, **kwargs)
            there = on_gpu(tensor) if device is None else device.type == "cuda"
        moved = self._moved(tensor, there)
        return moved if dtype is None else moved.to(dtype)

    def _moved(self, tensor: Tensor, there: bool) -> Tensor:
        if on_gpu(tensor) == there:
            return tensor
        assert not (torch.is_grad_enabled() and tensor.requires_grad), "gradients do not travel here"
        self.counts["uploads" if there else "downloads"] += 1
        return place(tensor.clone(), there)

    def _new_tensor(self, tensor: Tensor, *args: Any, **kwargs: Any) -> Tensor:
        self.counts["uploads"] += on_gpu(tensor)
        return place(tensor.new_tensor(*args, **kwargs), on_gpu(tensor))


class _Generator(torch.Generator):
    """One that may be made for the GPU."""

    def __new__(cls, device: Any = "cpu") -> "_Generator":
        generator = super().__new__(cls)
        generator.there = _is_cuda(device)
        return generator


def _is_cuda(device: Any) -> bool:
    return device is not None and torch.device(device).type == "cuda"


@pytest.fixture
def pretended_gpu(monkeypatch):
    """A machine with a GPU and a gsplat that was installed with its kernels; the pretended GPU."""
    gsplat = pytest.importorskip("gsplat", reason="needs gsplat's Python: pip install gsplat, no GPU needed")
    gpu = PretendedGPU()
    kernels = compiled_module(on_gpu, gpu.launch)
    monkeypatch.setitem(sys.modules, "gsplat.csrc", kernels)
    monkeypatch.setattr(gsplat, "csrc", kernels, raising=False)  # it has real ones where those were imported before
    monkeypatch.delitem(sys.modules, "gsplat.cuda._backend", raising=False)
    monkeypatch.setattr(torch, "Generator", _Generator)
    monkeypatch.setattr(torch.autograd, "_engine_run_backward", gpu.run_backward)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda *_: NAME)
    monkeypatch.setattr(torch.cuda, "is_current_stream_capturing", lambda: False)  # Adam asks; torch may know of CUDA
    with gpu.running():
        from baselines.splatting.backends import cuda, torch_ops

        monkeypatch.setattr(cuda, "step_ops", lambda: torch_ops)  # Triton's kernels would ask for a real one
        yield gpu
    sys.modules.pop("gsplat.cuda._backend", None)


@pytest.fixture
def cuda_backend(pretended_gpu):
    """The GPU's backend, on the pretended one."""
    from baselines.splatting.backends.cuda import CudaBackend

    return CudaBackend
