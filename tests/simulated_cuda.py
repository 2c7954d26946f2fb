"""A device for tests that behaves as a CUDA GPU would, on a machine without one.

Inside `simulated_cuda` a tensor on ``cuda:0`` is a `SimulatedCuda`: it says that it is there,
computes on the CPU, and raises where an operation mixes devices as CUDA would. What makes the host
wait for the device, such as reading a value back, is counted.
"""

import functools
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from unittest import mock

import torch
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten, tree_map

aten = torch.ops.aten
CUDA, CPU = torch.device("cuda", 0), torch.device("cpu")
WAITING = {
    *(aten._local_scalar_dense, aten.nonzero, aten.masked_select, aten.equal, aten.is_nonzero),
    *(aten._unique2, aten.unique_dim, aten.bincount, aten.repeat_interleave),
}
"""Operations whose result, or its shape, the host must know before it goes on."""
TAKES_CPU_INDICES = {aten.index, aten.index_put, aten.index_put_, aten._index_put_impl_}
FACTORIES = (
    *("arange", "as_tensor", "empty", "eye", "full", "linspace", "ones", "rand", "randint"),
    *("randn", "randperm", "tensor", "zeros"),
)
COPIES = {aten._to_copy, aten.copy_, aten._copy_from}


class SimulatedCuda(torch.Tensor):
    """A tensor that is ``inner``, on the CPU, in the guise of one on ``cuda:0``."""

    device = property(lambda self: CUDA)
    is_cuda = property(lambda self: True)
    is_meta = property(lambda self: False)

    @staticmethod
    def __new__(cls, inner: torch.Tensor) -> "SimulatedCuda":
        # Autograd runs on the device that C++ sees: the meta device needs no GPU.
        return torch.Tensor._make_wrapper_subclass(
            cls,
            inner.shape,
            strides=inner.stride(),
            storage_offset=inner.storage_offset(),
            dtype=inner.dtype,
            device="meta",
            requires_grad=inner.requires_grad,
        )

    def __init__(self, inner: torch.Tensor) -> None:
        self.inner = inner.detach()

    def __repr__(self) -> str:
        return f"SimulatedCuda({self.inner!r})"

    @classmethod
    def __torch_dispatch__(cls, func, types, args=(), kwargs=None):
        return _computed(func, args, kwargs or {})


# How often the host waited for the device, by operation.
_waits: Counter[str] = Counter()


def _inner(value):
    return value.inner if isinstance(value, SimulatedCuda) else value


def _outer(value):
    return SimulatedCuda(value) if isinstance(value, torch.Tensor) else value


def _require_one_device(func, args, kwargs) -> None:
    """As CUDA's kernels: a CPU tensor may be a number, or an index into one that is not."""
    values = tree_flatten((args, kwargs))[0]
    strangers = [
        value
        for value in values
        if isinstance(value, torch.Tensor) and not isinstance(value, SimulatedCuda) and value.dim()
    ]
    assert not any(type(value) is torch.Tensor and value.is_meta for value in values), func
    packet = func.overloadpacket
    if not strangers or packet in COPIES:
        return
    if packet in TAKES_CPU_INDICES and isinstance(args[0], SimulatedCuda):
        strangers = [value for value in strangers if not any(value is i for i in args[1])]
    if strangers:
        raise RuntimeError(f"{func}: Expected all tensors on one device, found cuda:0 and cpu")


def _computed(func, args, kwargs):
    """Runs an operation of ATen on the CPU, and wraps what CUDA would have left on the device."""
    _require_one_device(func, args, kwargs)
    packet, target = func.overloadpacket, kwargs.get("device")
    to_host = target is not None and not _is_cuda(target)
    if _is_cuda(target):
        kwargs = {**kwargs, "device": CPU}

    masks = packet in TAKES_CPU_INDICES and any(
        isinstance(i, SimulatedCuda) and i.dtype in (torch.bool, torch.uint8) for i in args[1]
    )
    copied_back = packet in COPIES and not isinstance(args[0], SimulatedCuda)
    # Told how long its result is, `repeat_interleave` does not ask the device.
    waits = packet in WAITING and kwargs.get("output_size") is None
    if waits or to_host or masks or copied_back:
        _waits[packet.__name__] += 1

    out = func(*tree_map(_inner, args), **tree_map(_inner, kwargs))

    # An operation in place gives back the very tensor that it was given.
    if func._schema.is_mutable and isinstance(out, torch.Tensor):
        for value in tree_flatten((args, kwargs))[0]:
            if _inner(value) is out:
                return value
    return out if to_host else tree_map(_outer, out)


def _factory(make):
    """A function that makes tensors, on the simulated device where a real one is asked for.

    In the place of the original: a mode does not see the calls of PyTorch's own Python code.
    """

    @functools.wraps(make)
    def made(*args, **kwargs):
        if _is_cuda(kwargs.get("device")):
            return _outer(make(*tree_map(_inner, args), **{**kwargs, "device": CPU}))
        return make(*args, **kwargs)

    return made


class _Methods(TorchFunctionMode):
    """What a tensor's methods do in C++ before anybody is asked."""

    def __torch_function__(self, func, types, args=(), kwargs=None):
        kwargs = dict(kwargs or {})
        name = getattr(func, "__name__", "")
        first = args[0] if args else None
        if isinstance(first, SimulatedCuda):
            if name == "tolist":
                _waits[name] += 1
                return first.inner.tolist()
            if name == "new_tensor":
                return _outer(first.inner.new_tensor(*args[1:], **{**kwargs, "device": CPU}))

        if name == "__getitem__" and isinstance(args[1], list | tuple):
            # Lists of indices would become tensors in C++, where no mode is asked.
            index = args[1] if isinstance(args[1], tuple) else (args[1],)
            index = tuple(torch.tensor(i) if isinstance(i, list) else i for i in index)
            return func(first, index)
        if name == "to":
            return self._moved(func, args, kwargs)
        return func(*args, **kwargs)

    def _moved(self, func, args, kwargs):
        """``tensor.to`` in all its forms; what is asked beside the device is done where it is."""
        tensor, *rest = args
        rest += kwargs.values()
        target = next((each for each in rest if isinstance(each, str | torch.device)), None)
        for other in rest:
            if isinstance(other, torch.Tensor):
                target = other.device
                rest.append(other.dtype)
        if _is_cuda(target) and not isinstance(tensor, SimulatedCuda):
            tensor = _outer(tensor)
        elif target is not None and not _is_cuda(target) and isinstance(tensor, SimulatedCuda):
            _waits["to"] += 1
            tensor = tensor.inner

        # What is asked beside the device: a dtype, a memory format, or both.
        kinds = {torch.dtype: "dtype", torch.memory_format: "memory_format"}
        asked = {kinds[type(each)]: each for each in rest if type(each) in kinds}
        return func(tensor, **asked) if asked else tensor


def _is_cuda(device) -> bool:
    # To C++ it is the meta device.
    return isinstance(device, str | torch.device) and torch.device(device).type in ("cuda", "meta")


class _Mixing(TorchDispatchMode):
    """Sees operations on CPU tensors alone, too, which no subclass hears of."""

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        # For numbers, C++ makes tensors where it believes the others to be: on the meta device.
        simulated = str(kwargs.get("device")) == "meta" or any(
            isinstance(value, SimulatedCuda) for value in tree_flatten((args, kwargs))[0]
        )
        return _computed(func, args, kwargs) if simulated else func(*args, **kwargs)


@contextmanager
def simulated_cuda() -> Iterator[Counter[str]]:
    """``cuda:0`` exists inside; yields the counter of what waited for it."""
    _waits.clear()
    with ExitStack() as patched:
        factories = {name: _factory(getattr(torch, name)) for name in FACTORIES}
        patched.enter_context(mock.patch.multiple(torch, **factories))
        patched.enter_context(_Mixing())
        patched.enter_context(_Methods())
        yield _waits
