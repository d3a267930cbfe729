"""Settings of Ha-NeRF and CR-NeRF for photographs of balls: networks that are trained in seconds."""

import balls

from baselines.cr_nerf.config import CrNerfConfig, StyleConfig, TransformConfig, TransientConfig
from baselines.ha_nerf.config import HaNerfConfig, LookConfig, VisibilityConfig

LOOK = LookConfig(size=8, channels=(8, 16, 16), side=24, rate=2e-3)
VISIBILITY = VisibilityConfig(
    code=16, octaves=4, width=32, layers=2, rate=1e-2, at_first=0.05, price=3.5, relative=True
)
STYLE = StyleConfig(channels=(8, 8, 16), side=24, rate=5e-3)
TRANSFORM = TransformConfig(size=8, hidden=(16,))
TRANSIENTS = TransientConfig(
    channels=8,
    dilations=(1, 2),
    side=24,
    rate=1e-2,
    at_first=0.05,
    price=1.0,
    relative=True,
    typical="mean",
)
HA_NERF = HaNerfConfig(balls.SMALL, LOOK, VISIBILITY, photographs=16)
CR_NERF = CrNerfConfig(balls.SHORT, 8, STYLE, TRANSFORM, TRANSIENTS, photographs=16)
