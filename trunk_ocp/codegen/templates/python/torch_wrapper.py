"""Shape of a muscular trunk for PyTorch, with autograd and torch.func.

    y = loaded(x)                   # (..., n, 19)
    y = unloaded(controls)          # (..., n, 16)

x, y, MUSCLES, INPUTS, OUTPUTS, pack and split are those of trunk_numpy.py in the same folder; pack
and split are for NumPy arrays.

NumPy solves for the loaded shape in double precision on the CPU; the result has the precision and
device of x, and its derivatives are exact, by the implicit function theorem. The unloaded shape is
pure PyTorch and has derivatives of any order.
"""

import torch
import trunk_numpy
from trunk_numpy import INPUTS, MUSCLES, OUTPUTS, Z, pack, split

__all__ = ["INPUTS", "MUSCLES", "OUTPUTS", "Z", "loaded", "pack", "split", "unloaded"]
SIZE = max(part.stop for part in INPUTS.values())


def loaded(x: torch.Tensor) -> torch.Tensor:
    """Shapes (..., n, 19) under load, for inputs (..., size).

    Raises trunk_numpy.NoShape if no equilibrium is found. Second derivatives, forward or by
    double backward, need an export with --second.
    """
    return _Loaded.apply(_of_size(x, SIZE, "x"))[0]


def unloaded(controls: torch.Tensor) -> torch.Tensor:
    """Unloaded shapes (..., n, 16) of activations and head angles (..., muscles + 2)."""
    controls = _of_size(controls, INPUTS["head"].stop, "controls")
    # The extra axis: some torch.func transforms turn tensors without axes to double precision.
    with torch.device(controls.device):
        return trunk_numpy.unloaded_in(torch, controls[None], slopes=False)[0][0]


def _of_size(x, size, name):
    if x.shape[-1:] != (size,) or not x.dtype.is_floating_point:
        raise ValueError(
            f"{name}: expected floating point of shape (..., {size}), got {x.dtype}, "
            f"{tuple(x.shape)}."
        )
    return x


class _Batched(torch.autograd.Function):
    """A function of arrays with leading axes; vmap passes it the whole batch at once."""

    @staticmethod
    def setup_context(ctx, inputs, output):
        ctx.save_for_backward(*inputs)
        ctx.save_for_forward(*inputs)

    @classmethod
    def vmap(cls, info, in_dims, *tensors):
        # Leading axes are matched by their number, so the new one goes first in every tensor.
        moved = [
            t.expand(info.batch_size, *t.shape) if dim is None else t.movedim(dim, 0)
            for t, dim in zip(tensors, in_dims, strict=True)
        ]
        result = cls.apply(*moved)
        return result, (0,) * len(result) if isinstance(result, tuple) else 0


def _numpy(function, *tensors):
    """Results of a NumPy function, in the precision and on the device of the first tensor."""
    like = tensors[0]
    results = function(*(t.detach().cpu().numpy().astype(float) for t in tensors))
    results = results if isinstance(results, tuple) else (results,)
    return tuple(torch.as_tensor(part, dtype=like.dtype, device=like.device) for part in results)


def _pushed(J, v):
    """Changes (..., n, 19) of y, for J (..., n, 19, size) and v (..., size)."""
    return (J @ v[..., None, :, None])[..., 0]


def _pulled(weights, J):
    """Weights (..., size) of x from weights (..., n, 19) of y."""
    return (weights[..., None, :] @ J)[..., 0, :].sum(-2)


class _Loaded(_Batched):
    """x -> y, J. J is marked as a constant: `_Pull` and `_Push` have its derivatives."""

    @staticmethod
    def forward(x):
        return _numpy(trunk_numpy.jacobian, x)

    @staticmethod
    def setup_context(ctx, inputs, output):
        ctx.mark_non_differentiable(output[1])
        _Batched.setup_context(ctx, (*inputs, output[1]), output)

    @staticmethod
    def backward(ctx, weights, _):
        return _Pull.apply(*ctx.saved_tensors, weights)

    @staticmethod
    def jvp(ctx, v):
        x, J = ctx.saved_tensors
        return _Push.apply(x, J, v), None


class _Pull(_Batched):
    """x, J, weights of y -> weights of x: weights J(x)."""

    @staticmethod
    def forward(x, J, weights):
        return _pulled(weights, J)

    @staticmethod
    def backward(ctx, v):
        x, J, weights = ctx.saved_tensors
        along = _pulled(weights, _Second.apply(x, v))
        return along, None, _Push.apply(x, J, v)

    @staticmethod
    def jvp(ctx, v, _, d_weights):
        x, J, weights = ctx.saved_tensors
        change = torch.zeros_like(x)
        if v is not None:
            change = change + _pulled(weights, _Second.apply(x, v))
        return change if d_weights is None else change + _Pull.apply(x, J, d_weights)


class _Push(_Batched):
    """x, J, v -> J(x) v."""

    @staticmethod
    def forward(x, J, v):
        return _pushed(J, v)

    @staticmethod
    def backward(ctx, weights):
        x, J, v = ctx.saved_tensors
        along = _pulled(weights, _Second.apply(x, v))
        return along, None, _Pull.apply(x, J, weights)

    @staticmethod
    def jvp(ctx, w, _, d_v):
        x, J, v = ctx.saved_tensors
        change = torch.zeros((*J.shape[:-1],), dtype=x.dtype, device=x.device)
        if w is not None:
            change = change + _pushed(_Second.apply(x, w), v)
        return change if d_v is None else change + _Push.apply(x, J, d_v)


class _Second(_Batched):
    """x, v -> derivative of J(x) along v; by symmetry also d(J v)/dx."""

    @staticmethod
    def forward(x, v):
        if not hasattr(trunk_numpy, "second"):
            raise NotImplementedError("second derivatives: export again with --second.")
        return _numpy(trunk_numpy.second, x, v)[0]

    @staticmethod
    def backward(ctx, weights):
        raise NotImplementedError("third derivatives of the loaded shape are not exported.")
