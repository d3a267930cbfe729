import math

import numpy as np
import pytest
from scipy.optimize import brentq

from hydroviews.rain.other_make.refraction import MENISCUS, WATER, Bodies, leave_drop


def bodies(n, meniscus, rng):
    """Stretched, leaning drops of all contact angles, float64."""
    turn, long = rng.uniform(0, np.pi, n), rng.uniform(1, 1.4, n)[:, None, None]
    along = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    across = np.stack([-np.sin(turn), np.cos(turn)], axis=1)
    inverse = along[:, :, None] * along[:, None] / long + across[:, :, None] * across[:, None] * long
    contact = np.radians(rng.uniform(15, 75, n))
    return Bodies(inverse, rng.uniform(-0.3, 0.3, (n, 2)), contact, np.full(n, meniscus))


def traced(place, ray, inverse, lean, contact, meniscus):
    """One ray, by root finding on the surface in the world, a numerical normal, and angles instead of vectors."""

    def outside(p):
        x, y = inverse @ (p[:2] - lean * p[2])
        rho = math.hypot(x, y)
        if meniscus:
            return p[2] - math.tan(contact) / MENISCUS * (1 - rho**MENISCUS)
        depth = 1 / math.tan(contact)
        return math.hypot(rho, p[2] + depth) - 1 / math.sin(contact)

    tilt = math.asin(math.sin(math.atan(math.hypot(*ray))) / WATER)
    turn = math.atan2(ray[1], ray[0])
    way = np.array([math.sin(tilt) * math.cos(turn), math.sin(tilt) * math.sin(turn), math.cos(tilt)])
    start = np.array([*(np.linalg.inv(inverse) @ place), 0.0])
    hit = start + brentq(lambda s: outside(start + s * way), 0, 3, xtol=1e-14) * way
    normal = np.array([outside(hit + 1e-6 * e) - outside(hit - 1e-6 * e) for e in np.eye(3)])
    normal /= np.linalg.norm(normal)
    inner = math.acos(min(1.0, way @ normal))
    if WATER * math.sin(inner) >= 1:
        return None, 0.0
    outer = math.asin(WATER * math.sin(inner))
    sideways = way - (way @ normal) * normal
    sideways /= max(np.linalg.norm(sideways), 1e-12)
    total, less = outer + inner, outer - inner
    reflected = (math.sin(less) / math.sin(total)) ** 2 / 2 + (math.tan(less) / math.tan(total)) ** 2 / 2
    return math.cos(outer) * normal + math.sin(outer) * sideways, 1 - reflected


@pytest.mark.parametrize("meniscus", [False, True])
def test_rays_leave_drops_as_traced_one_by_one_in_double_precision(meniscus):
    rng = np.random.default_rng(4)
    n = 300
    radius, angle = np.sqrt(rng.uniform(0, 0.95, n)), rng.uniform(0, 2 * np.pi, n)
    place = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ray, drops = rng.uniform(-0.5, 0.5, (n, 2)), bodies(n, meniscus, rng)
    out = leave_drop(place, ray, drops)
    lost = 0
    for i in range(n):
        direction, passing = traced(place[i], ray[i], drops.inverse[i], drops.lean[i], drops.contact[i], meniscus)
        assert out.passing[i] == pytest.approx(passing, abs=2e-4 if passing else 0)
        if direction is None:
            lost += 1
            assert np.isnan(out.direction[i]).all()
        else:
            np.testing.assert_allclose(out.direction[i], direction, atol=2e-5)
    assert 0 < lost < n / 2  # steep rims reflect everything
