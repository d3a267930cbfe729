"""A rain effect in one file: flakes of ash, fresh in every view."""

from dataclasses import asdict, dataclass

import numpy as np

from hydroviews.rain.compositing import LayerPlane
from hydroviews.rain.effect import Effect
from hydroviews.rain.patterns import pattern_generator


@dataclass(frozen=True)
class AshPattern:
    cover: float  # share of the picture
    grey: float  # encoded value of a flake


class Ash(Effect):
    planes = {"A": LayerPlane("cover by ash", "water")}  # noqa: RUF012
    needed = ("grey",)
    words = {"cover": "ash over {:.0%} of the picture", "grey": "of grey {:.2f}"}  # noqa: RUF012

    def draw(self, pattern, statistics):
        rng = pattern_generator(pattern, statistics)
        return AshPattern((0.05, 0.1, 0.2)[pattern.level], round(float(rng.uniform(0.4, 0.6)), 3))

    def place(self, drawn, pattern, statistics):
        return FallingAsh(drawn, pattern, statistics)

    def composite(self, parameters, clean, layers):
        cover = layers["A"][..., None]
        return (1 - cover) * clean + np.float32(parameters["grey"]) * cover


class FallingAsh:
    def __init__(self, drawn, pattern, statistics):
        self.parameters, self.pattern, self.statistics = asdict(drawn), pattern, statistics

    def prepare(self, camera, folder):
        return self

    def layers(self, clean, view):
        rng = pattern_generator(self.pattern, self.statistics, view.name)
        return {"A": (rng.random(clean.shape[:2]) < self.parameters["cover"]).astype(np.float32)}


class AshBySize(Ash):
    """Ash that is prepared for every size of picture, and puts that into its parameters: careless."""

    needs_optics = True

    def place(self, drawn, pattern, statistics):
        return AshOfOneSize(drawn, pattern, statistics)


class AshOfOneSize(FallingAsh):
    def prepare(self, camera, folder):
        self.parameters = self.parameters | {"width": camera.width}
        return self
