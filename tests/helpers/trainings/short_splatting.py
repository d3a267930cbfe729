"""Plain splatting that ends after a few steps."""

from dataclasses import replace
from typing import ClassVar

from trainings import CONFIG

from baselines.gaussian_splatting import GaussianSplatting


class ShortSplatting(GaussianSplatting):
    """3DGS of 30 steps."""

    profiles: ClassVar = {"demo": replace(CONFIG, iterations=30)}
