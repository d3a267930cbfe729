"""The detector's loss: its values, batches that have no direction, and that it learns what it is told."""

import pytest
import torch

from baselines.occ_nerf.detector import Detector, correlation_loss

EVERY = torch.ones(4)
GAPS = torch.tensor([0.0, 0.1, 0.3, 0.8])


@pytest.mark.parametrize(
    ("m", "gaps", "expected"),
    [
        (0.5 + 0.4 * (GAPS - 0.2), GAPS, 0.0),
        (0.5 - 0.4 * (GAPS - 0.2), GAPS, 2.0),
        (torch.full((4,), 0.3), GAPS, 1 + 0.4 * 0.2 / (0.4 * 0.42**0.5)),
        (torch.full((4,), 0.3), 0 * GAPS, 0.0),  # without any foreground every m below a half is right
        (torch.full((4,), 0.7), 0 * GAPS, 2.0),
    ],
)
def test_the_loss_is_one_less_the_cosine(m, gaps, expected):
    assert float(correlation_loss(m, gaps, 0.2, EVERY)) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ("m", "gaps", "counts"),
    [
        (torch.full((4,), 0.5), GAPS, EVERY),
        (torch.full((4,), 0.7), torch.full((4,), 0.2), EVERY),
        (torch.full((4,), 0.5), torch.full((4,), 0.2), EVERY),
        (torch.full((4,), 0.7), GAPS, torch.zeros(4)),
    ],
    ids=["undecided", "at the threshold", "both", "all masked"],
)
def test_a_batch_without_direction_gives_one_and_a_finite_gradient(m, gaps, counts):
    m = m.clone().requires_grad_()
    loss = correlation_loss(m, gaps, 0.2, counts)
    loss.backward()
    assert loss.item() == pytest.approx(1)
    assert torch.isfinite(m.grad).all()


def test_it_learns_to_tell_large_gaps():
    generator = torch.Generator().manual_seed(0)
    detector = Detector(8, generator)
    optimiser = torch.optim.Adam(detector.parameters(), lr=5e-3)
    for step in range(200):
        weights, near, gap = torch.rand(256, 8, generator=generator), *torch.rand(2, 256, generator=generator) / 2
        m = detector(weights / 8, near, near + gap)
        if step == 199:
            clear = (gap - 0.2).abs() > 0.05
            assert float(((m > 0.5) == (gap > 0.2))[clear].float().mean()) > 0.95
        optimiser.zero_grad()
        correlation_loss(m, gap, 0.2, torch.ones(256)).backward()
        optimiser.step()
