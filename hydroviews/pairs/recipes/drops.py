"""Light and focus of a pane's drops: light of their own or of the scene, sharp or blurred."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from hydroviews.pairs.recipes.compositing import Space, put_over
from hydroviews.pairs.recipes.fields import Plane, clouds, halved, log_uniform, mean_colour, tinted
from hydroviews.pairs.recipes.shapes import draw_shapes
from hydroviews.pairs.recipes.stamps import Stamped, stamp
from hydroviews.rain.lens.optics.path_matte import defocus
from hydroviews.scene.images import Image

ALL_OWN, NO_OWN = 0.5, 0.25  # shares of the panes whose drops have light of their own alone, and none
SCREENED = 0.2  # share of the panes with light alone that is put on as a screen
CONTENTS = {"refracted": 0.55, "blurred": 0.25, "mean": 0.2}  # shares of what of the scene drops show
FOCUSES = {"sharp": 0.5, "gaussian": 0.15, "disk": 0.1, "tilted": 0.25}
WIDEST_DISK = 0.04  # diameter in sides of the picture
NEAR = 0.3  # share of the way across a tilted pane that is in focus
BELOW = 0.7  # share of the panes whose drops are bright below, as drops before a bright sky are
RIMS = {"none": 0.35, "dark": 0.45, "bright": 0.2}


@dataclass(frozen=True, eq=False)
class Drops:
    """Drops on a pane; light is that of the space in which they are put on."""

    cover: Plane  # [H, W], [0, 1]
    own: Image  # [H, W, 3], light of their own, times cover
    through: Plane  # [H, W], the share of cover that shows the scene, in focus
    shown: Plane  # the same, as sharp as the drops are
    source: NDArray[np.float32] | None  # [H, W, 2], the column and row that a drop shows at each pixel
    content: str  # a key of CONTENTS
    blur: float  # standard deviation, pixels, of the scene that drops show
    spread: float  # standard deviation, pixels, by which what they show is out of focus
    gain: float  # of the light of what they show
    screen: bool  # see compositing.put_over

    def over(self, scene: Image) -> Image:
        """A scene [H, W, 3] behind the drops, both in the drops' space; not clipped."""
        light = self.own if not self.shown.any() else self.own + self.gain * self._of_scene(scene)
        return put_over(scene, self.cover[..., None], light, self.screen)

    def half(self) -> "Drops":
        """The same for pictures of half the width and height."""
        cover, own, through, shown = (halved(plane) for plane in (self.cover, self.own, self.through, self.shown))
        source = None if self.source is None else halved(self.source) / 2
        parts = {"cover": cover, "own": own, "through": through, "shown": shown, "source": source}
        return replace(self, **parts, blur=self.blur / 2, spread=self.spread / 2)  # type: ignore[arg-type]

    def _of_scene(self, scene: Image) -> Image:
        """The scene as drops show it [H, W, 3], times the share of cover that shows it."""
        shown = self.shown[..., None]
        if self.content == "mean" or self.source is None:
            seen = mean_colour(scene) if self.content == "mean" else _blurred(scene, self.blur)
            return np.asarray(shown * seen, np.float32)
        columns, rows = cv2.split(self.source)
        flags, border = cv2.INTER_LINEAR, cv2.BORDER_REFLECT
        seen = np.asarray(cv2.remap(_blurred(scene, self.blur), columns, rows, flags, borderMode=border), np.float32)
        if self.spread < 0.3:
            return np.asarray(shown * seen, np.float32)
        light, share = _blurred(self.through[..., None] * seen, self.spread), _blurred(self.through, self.spread)
        return np.asarray(light * (self.shown / np.maximum(share, 1e-3))[..., None], np.float32)


def draw_drops(rng: np.random.Generator, width: int, height: int, space: Space) -> tuple[Drops, Plane]:
    """Drops of any size, number, light and focus, and their cover [height, width] in focus."""
    stamped = stamp(draw_shapes(rng, width, height), width, height)
    own, content = _draw_own_share(rng), str(rng.choice(list(CONTENTS), p=list(CONTENTS.values())))
    inside = stamped.cover > 0
    opacity = float(rng.uniform(0.7, 1)) if rng.uniform() < 0.4 else 1.0
    cover = (stamped.cover * opacity)[inside]
    focused, spread = draw_focus(rng, width, height)
    passing, added = _draw_rim(rng, stamped.place[inside])
    glare = float(rng.uniform(1, 2)) if spread > 1 else 1.0  # of bright light that is spread
    light = _own_light(rng, stamped, inside, space, glare)
    light = own * light * passing[:, None] + added[:, None]
    through = _plane(inside, (1 - own) * cover * passing)
    planes = [_plane(inside, cover), _plane(inside, cover[:, None] * light), through]
    soft, lit, shown = (focused(plane) if plane.any() else plane for plane in planes)
    screen = own == 1 and rng.uniform() < SCREENED
    lit = np.clip(lit, 0, 1) if screen else lit
    drops = Drops(
        cover=np.asarray(lit.mean(axis=-1) if screen else np.clip(soft, 0, 1), np.float32),
        own=lit,
        through=through,
        shown=shown,
        source=_draw_source(rng, stamped) if content == "refracted" and own < 1 else None,
        content=content,
        blur=log_uniform(rng, 0.3, 5),
        spread=spread,
        gain=float(rng.uniform(0.75, 1.25)),
        screen=screen,
    )
    return drops, stamped.cover


def draw_focus(rng: np.random.Generator, width: int, height: int) -> tuple[Callable[[Plane], Plane], float]:
    """A function that blurs planes [H, W] or [H, W, 3] as drops are out of focus, and its spread in pixels."""
    kind, side = str(rng.choice(list(FOCUSES), p=list(FOCUSES.values()))), float(np.sqrt(width * height))
    if kind == "sharp":
        sigma = float(rng.uniform(0, 0.6))
        return (lambda plane: _blurred(plane, sigma)), sigma
    if kind == "gaussian":
        sigma = log_uniform(rng, 0.5, 4)
        return (lambda plane: _blurred(plane, sigma)), sigma
    disk = log_uniform(rng, 0.005, WIDEST_DISK) * side
    if kind == "disk":
        return (lambda plane: defocus(plane, disk)), disk / 4
    disk, far = max(disk, 0.4 * WIDEST_DISK * side), _far_side(rng, width, height)
    return (lambda plane: _tilted(plane, far, disk)), disk / 4


def _far_side(rng: np.random.Generator, width: int, height: int) -> Plane:
    """How far out of focus a tilted pane is, [height, width]: 0 at the near side, 1 at the far one."""
    turn = rng.uniform(0, 2 * np.pi)
    y, x = np.mgrid[-0.5 : 0.5 : height * 1j, -0.5 : 0.5 : width * 1j].astype(np.float32)
    across = np.cos(turn) * x + np.sin(turn) * y
    share = (across - across.min()) / (across.max() - across.min())
    return np.asarray(np.clip((share - NEAR) / (1 - NEAR), 0, 1), np.float32)


def _tilted(plane: Plane, far: Plane, disk: float) -> Plane:
    """A plane blurred by a disk that grows across it; planes blurred by two disks and the sharp one are mixed."""
    half, whole = (defocus(plane, share * disk) for share in (0.4, 1))
    low, high = np.clip(far / 0.4, 0, 1), np.clip((far - 0.4) / 0.6, 0, 1)
    low, high = (weight.reshape(*far.shape, *(1,) * (plane.ndim - 2)) for weight in (low, high))
    return np.asarray(plane + low * (half - plane) + high * (whole - half), np.float32)


def _draw_own_share(rng: np.random.Generator) -> float:
    chance = float(rng.uniform())
    if chance < ALL_OWN:
        return 1.0
    return 0.0 if chance < ALL_OWN + NO_OWN else float(rng.uniform(0.3, 0.95))


def _own_light(
    rng: np.random.Generator, stamped: Stamped, inside: NDArray[np.bool_], space: Space, glare: float
) -> NDArray[np.float32]:
    """Light [P, 3] of the pixels inside drops: a dark and a bright part, in the same direction in all drops.

    The edge between both is an arc. Its radius is from a small part of a drop, which makes rings, to many drops.
    """
    place = stamped.place[inside]
    turn = rng.normal(np.pi / 2, 0.4) if rng.uniform() < BELOW else rng.uniform(0, 2 * np.pi)
    towards = np.array([np.cos(turn), np.sin(turn)], np.float32)
    arc = log_uniform(rng, 0.1, 6)
    hollow = rng.uniform() < 0.5
    along = np.linalg.norm(place + (arc if hollow else -arc) * towards, axis=1)
    along = along - arc if hollow else arc - along
    soft = log_uniform(rng, 0.25, 1.5)
    share = np.clip((along - rng.uniform(-0.6, 0.4)) / soft + 0.5, 0, 1).astype(np.float32)
    share = (share * share * (3 - 2 * share))[:, None]
    bright = glare * space.decoded(tinted(rng, float(rng.uniform(0.6, 1)), float(rng.uniform(0, 0.08))))
    dark = space.decoded(tinted(rng, float(rng.uniform(0.02, 0.3)), 0.2))
    height, width = stamped.cover.shape
    uneven = np.clip(0.5 + 0.4 * clouds(rng, width, height, 0.2 * np.sqrt(width * height))[inside], 0, 1)
    each = np.exp(rng.uniform(0, 0.3) * rng.normal(size=int(stamped.owner.max(initial=-1)) + 2))
    lit = (1 - rng.uniform(0, 0.6) * uneven) * each[stamped.owner[inside]]
    return np.asarray(np.clip(lit[:, None] * (dark + share * (bright - dark)), 0, glare), np.float32)


def _draw_rim(rng: np.random.Generator, place: NDArray[np.float32]) -> tuple[Plane, Plane]:
    """For pixels [P, 2] inside drops, the share of light that their rims let pass, and light added; both [P]."""
    far = np.linalg.norm(place, axis=1)
    passing, added = np.ones_like(far), np.zeros_like(far)
    kind = str(rng.choice(list(RIMS), p=list(RIMS.values())))
    rim = np.clip((far - 1) / rng.uniform(0.1, 0.5) + 1, 0, 1) * rng.uniform(0.3, 1)
    if kind != "none":
        passing -= rim
    if kind == "bright":
        added += rng.uniform(0.5, 1) * rim
    if rng.uniform() < 0.25:
        spot = np.linalg.norm(place - rng.uniform(-0.5, 0.5, 2), axis=1)
        added += rng.uniform(0.4, 1) * np.clip(2 - spot / rng.uniform(0.1, 0.25), 0, 1)
    return np.asarray(passing, np.float32), np.asarray(added, np.float32)


def _draw_source(rng: np.random.Generator, stamped: Stamped) -> NDArray[np.float32]:
    """The place that each pixel of a drop shows, [H, W, 2]: shrunk, mostly upside down, alike in all drops."""
    height, width = stamped.cover.shape
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float32)
    reach = log_uniform(rng, 0.03, 0.4) * np.sqrt(width * height) * (1 if rng.uniform() < 0.25 else -1)
    return np.asarray(grid + np.float32(reach) * stamped.place, np.float32)


def _plane(inside: NDArray[np.bool_], values: NDArray) -> NDArray[np.float32]:
    plane = np.zeros((*inside.shape, *values.shape[1:]), np.float32)
    plane[inside] = values
    return plane


def _blurred(plane: NDArray[np.float32], sigma: float) -> NDArray[np.float32]:
    if sigma < 0.25:
        return plane
    return np.asarray(cv2.GaussianBlur(plane, (0, 0), sigma), np.float32)
