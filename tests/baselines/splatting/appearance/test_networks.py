"""Linear layers of parts: what the layer makes of them side by side, with its gradients."""

import pytest
import torch
from torch import nn

from baselines.splatting.appearance.networks import linear_of_parts


def test_parts_are_those_side_by_side_with_their_gradients():
    linear = nn.Linear(9, 4).double()
    parts = [torch.randn(5, width, dtype=torch.float64, requires_grad=True) for width in (2, 3, 4)]
    pull = torch.randn(5, 4, dtype=torch.float64)
    said, expected = linear_of_parts(linear, *parts), linear(torch.cat(parts, dim=1))
    assert torch.allclose(said, expected)
    learned = [*parts, *linear.parameters()]
    for found, true in zip(
        torch.autograd.grad(said, learned, pull), torch.autograd.grad(expected, learned, pull), strict=True
    ):
        assert torch.allclose(found, true)


def test_a_number_stands_for_a_part_of_zeros():
    linear, part = nn.Linear(7, 3), torch.randn(5, 2)
    assert torch.allclose(linear_of_parts(linear, part, 5), linear(torch.cat([part, torch.zeros(5, 5)], dim=1)))


def test_widths_that_do_not_add_up_are_refused():
    with pytest.raises(ValueError, match="6 numbers for a layer of 7"):
        linear_of_parts(nn.Linear(7, 3), torch.randn(5, 2), torch.randn(5, 4))
