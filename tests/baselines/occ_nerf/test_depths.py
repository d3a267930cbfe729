"""The two depths of a ray against what they are by hand, and the loss of the detector that compares them."""

import numpy as np
import pytest
import torch

from baselines.occ_nerf.depths import depth, depth_from_behind, middles
from baselines.occ_nerf.detector import Detector, correlation_loss
from baselines.volumetric.compositing import INFINITE, compositing_weights
from baselines.volumetric.rays.rays import WorldRays
from baselines.volumetric.rays.spaces import NDC, Contracted

FORWARD = NDC(((1.0, 0, 0, 0), (0, 1.0, 0, 0), (0, 0, 1.0, 0), (0, 0, 0, 1.0)), (1.0, 1.0), 1.0)
AROUND = Contracted((0.0, 0.0, 0.0), 1.0, 0.5, 8.0)
SAMPLES = 100
EDGES = torch.linspace(0, 1, SAMPLES + 1, dtype=torch.float64)[None]
NEAR, FAR = 8, 79  # intervals whose middles are at 0.085 and 0.795


def both(alphas, open_end=True, dtype=torch.float64, elsewhere=0.0):
    """Depth and depth from behind of a ray with given alphas in some intervals; `elsewhere` is the other density."""
    lengths = torch.full((1, SAMPLES), 1 / SAMPLES, dtype=dtype)
    if open_end:
        lengths[:, -1] = INFINITE
    density = torch.full((1, SAMPLES), elsewhere, dtype=dtype)
    for interval, alpha in alphas.items():
        density[0, interval] = 1e12 if alpha == 1 else -np.log1p(-alpha) * SAMPLES
    positions = middles(EDGES.to(dtype), FORWARD, open_end)
    weights, _ = compositing_weights(density, lengths)
    near, behind = depth(weights, positions), depth_from_behind(density, lengths, positions, open_end)
    return float(near), float(behind)


@pytest.mark.parametrize("open_end", [True, False])
@pytest.mark.parametrize(
    ("alphas", "expected"),
    [
        ({}, (1, 1)),
        ({FAR: 1}, (0.795, 0.795)),
        ({FAR: 0.7}, (0.7 * 0.795 + 0.3, 0.7 * 0.795 + 0.3)),
        ({NEAR: 1, FAR: 1}, (0.085, 0.795)),
        (
            {NEAR: 0.6, FAR: 0.7},
            (0.6 * 0.085 + 0.4 * 0.7 * 0.795 + 0.4 * 0.3, 0.7 * 0.795 + 0.3 * 0.6 * 0.085 + 0.4 * 0.3),
        ),
        (dict.fromkeys(range(SAMPLES - 1), 1), (0.005, 0.985)),
    ],
    ids=["empty", "surface", "half a surface", "two", "two halves", "saturated"],
)
def test_depths_are_those_of_the_first_and_the_last_surface(alphas, expected, open_end):
    assert both(alphas, open_end) == pytest.approx(expected, abs=1e-9)


def test_what_reaches_to_infinity_is_behind_everything():
    assert both({SAMPLES - 1: 1}) == pytest.approx((1, 1), abs=1e-12)
    assert middles(EDGES, FORWARD, True)[0, -1] == 1
    assert middles(EDGES, FORWARD, False)[0, -1] == pytest.approx(0.995)


def test_the_contracted_space_has_the_depth_that_device_coordinates_have_from_its_near_plane():
    positions = middles(EDGES, AROUND, False)
    beside = WorldRays(np.array([[0.3, 0, 0]]), np.array([[0, 0, 1.0]]))
    ahead = NDC(FORWARD.pose, (1.0, 1.0), AROUND.near).from_world(beside, torch.device("cpu"))
    z = AROUND.s_to_t((EDGES[:, 1:] + EDGES[:, :-1]) / 2)
    torch.testing.assert_close(ahead.points(positions)[..., 0].double(), 0.3 / z, atol=1e-6, rtol=1e-5)
    assert middles(EDGES, AROUND, True)[0, -1] == 1


def test_an_occluder_does_not_change_the_depth_from_behind():
    """Densities are nowhere nought, as those of networks: an infinite last interval would hide all the others."""
    assert both({FAR: 1}, elsewhere=1e-3) == pytest.approx((0.8, 0.8), abs=0.02)
    assert both({NEAR: 1, FAR: 1}, elsewhere=1e-3) == pytest.approx((0.085, 0.8), abs=0.02)


def test_thin_matter_behind_opaque_matter_is_not_lost():
    found = both({NEAR: 1, FAR: 0.5}, dtype=torch.float32)
    assert found == pytest.approx((0.085, 0.5 * 0.795 + 0.5 * 0.085), abs=1e-5)


def test_depths_of_huge_densities_are_finite_with_their_gradients():
    density = torch.tensor([[0.0, 1e30, 0.0, 1e30], [0.0] * 4, [1e30] * 4, [1e-30] * 4], requires_grad=True)
    lengths = torch.tensor([[1.0, 1.0, 1.0, INFINITE]]).expand(4, -1)
    positions = middles(torch.linspace(0, 1, 5)[None], FORWARD, True).expand(4, -1)
    weights, _ = compositing_weights(density, lengths)
    found = torch.cat([depth(weights, positions), depth_from_behind(density, lengths, positions, True)])
    assert ((found >= 0) & (found <= 1)).all()
    found.sum().backward()
    assert torch.isfinite(density.grad).all()


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
    for _ in range(200):
        weights, near, gap = torch.rand(256, 8, generator=generator), *torch.rand(2, 256, generator=generator) / 2
        m = detector(weights / 8, near, near + gap)
        optimiser.zero_grad()
        correlation_loss(m, gap, 0.2, torch.ones(256)).backward()
        optimiser.step()
    clear = (gap - 0.2).abs() > 0.05
    assert float(((m > 0.5) == (gap > 0.2))[clear].float().mean()) > 0.95
