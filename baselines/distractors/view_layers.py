"""Gaussians of each view in front of its camera, composited over the scene (DeSplat, Wang et al. 2025, section 3).

    C = C_d + (1 - A_d) C_s

C_d and A_d are the colour and the opacity of the view's layer, C_s is the render of the scene on its background. A
layer is seen by no other camera, so it is kept in its camera's own axes, at depths of about 1: where in the world it
lies is of no consequence. It takes what the scene, which all views share, cannot explain.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from baselines.splatting.files.checkpoints import PARTS
from baselines.splatting.gaussians import FIELDS, Gaussians
from baselines.splatting.kernels.adam import adam_step
from baselines.splatting.kernels.buffer_pool import BufferPool
from baselines.splatting.kernels.photometric import Plane
from baselines.splatting.kernels.splats.sh_coefficients import C0, from_colour
from baselines.splatting.rasterizer import BLACK, RenderState, backward_sh_sets, render_sh_sets
from baselines.splatting.schedule import LearningRates, Stream, random_stream, rates_at
from baselines.splatting.state import TrainingState, fresh_state
from baselines.splatting.strategies.densification import DefaultStrategy, grow, grow_due, observe
from hydroviews.scene.cameras import Camera
from hydroviews.scene.images import Image

DEPTHS = (0.5, 1.5)
MOST_VISITS = 1_000_000  # of a view, so that no two draws have one generator


@dataclass(frozen=True)
class LayerConfig:
    """A layer's Gaussians; the defaults are the authors' where they are in their units, at depth 1 instead of 0.02.

    Attributes:
        number: number of Gaussians of a layer at the start.
        opacity: opacity of a Gaussian at the start, (0, 1).
        spread: standard deviation at the start, in mean distances to the next one.
        cover_penalty: weight of the mean opacity A_d in the loss, at least 0.
        learning_rates: Adam's; positions in units of the depth.
        growth: when and where a layer grows; iterations are visits of its view, lengths are in units of the depth.
    """

    number: int = 1000
    opacity: float = 0.1
    spread: float = 1.0
    cover_penalty: float = 0.01
    learning_rates: LearningRates = field(
        default_factory=lambda: LearningRates(
            means=8e-3, means_final=8e-5, sh=0.025 / C0, opacity=0.05, scales=0.05, quaternions=0.01
        )
    )
    growth: DefaultStrategy = field(
        default_factory=lambda: DefaultStrategy(
            start=10, stop=100, every=10, budget=2000, grow_scale3d=0.02, prune_scale3d=10.0, reset_every=None
        )
    )


@dataclass(frozen=True)
class RenderedLayer:
    """A layer as its camera sees it."""

    colour: Image  # C_d [H, W, 3]
    cover: Plane  # A_d [H, W]
    state: RenderState


def first_layer(camera: Camera, config: LayerConfig, generator: np.random.Generator) -> TrainingState:
    """Round Gaussians of random colours, spread evenly over the picture, at depths of about 1."""
    n = config.number
    depth = generator.uniform(*DEPTHS, n)
    pixels = generator.random((n, 2)) * (camera.width, camera.height)
    slopes = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    distance = np.sqrt(camera.width * camera.height / max(n, 1) / (camera.fx * camera.fy))
    quaternions = np.zeros((n, 4), np.float32)
    quaternions[:, 0] = 1
    gaussians = Gaussians(
        means=(np.concatenate([slopes, np.ones((n, 1))], axis=1) * depth[:, None]).astype(np.float32),
        quaternions=quaternions,
        log_scales=np.repeat(np.log(config.spread * distance * depth)[:, None], 3, axis=1).astype(np.float32),
        opacity_logits=np.full(n, np.log(config.opacity / (1 - config.opacity)), np.float32),
        sh=np.ascontiguousarray(from_colour(generator.random((n, 1, 3))), np.float32),
    )
    return fresh_state(gaussians)


def layer_stream(seed: int, view: int, visits: int) -> np.random.Generator:
    """The generator for a view's layer after so many visits."""
    return random_stream(seed, Stream.LAYERS, view * MOST_VISITS + visits)


def render_layer(gaussians: Gaussians, camera: Camera, buffers: BufferPool) -> RenderedLayer:
    """A layer in its camera; the cover is the colour of the same Gaussians in white on black, to have its gradient.

    Args:
        gaussians: of the layer.
        camera: of the view; where it stands does not matter.
        buffers: of its own: the next render with it overwrites the arrays.
    """
    sets = np.stack([gaussians.sh, np.broadcast_to(from_colour(np.ones((1, 3))), gaussians.sh.shape)])
    here = replace(camera, world_to_camera=np.eye(4))
    images, state = render_sh_sets(gaussians, sets.astype(np.float32), here, BLACK, 0, buffers=buffers)
    return RenderedLayer(images[0], images[1, ..., 0], state)


def composited(layer: RenderedLayer, scene: Image) -> Image:
    """C [H, W, 3]."""
    return layer.colour + (1 - layer.cover[..., None]) * scene


def gradients_of(
    layer: RenderedLayer, scene: Image, grad: Image, cover_penalty: float
) -> tuple[Image, NDArray[np.float32]]:
    """From dloss/dC [H, W, 3] to those by C_s [H, W, 3], and by C_d and A_d, as `learn` wants them [2, H, W, 3].

    Args:
        layer: as it was composited.
        scene: C_s.
        grad: dloss/dC.
        cover_penalty: whose gradient, of the mean of A_d, is added.
    """
    by_sets = np.zeros((2, *grad.shape), np.float32)
    by_sets[0] = grad
    by_sets[1, ..., 0] = cover_penalty / layer.cover.size - (grad * scene).sum(axis=2)
    return (1 - layer.cover[..., None]) * grad, by_sets


def learn(
    state: TrainingState, layer: RenderedLayer, by_sets: NDArray[np.float32], progress: float, config: LayerConfig
) -> TrainingState:
    """A step of Adam of a layer's Gaussians, in place, and the state after it.

    Args:
        state: of the layer; its iterations are the visits of its view.
        layer: rendered from it.
        by_sets: from `gradients_of`.
        progress: share of the training's iterations that are done.
        config: settings.
    """
    gradients, _ = backward_sh_sets(layer.state, by_sets)
    observe(state, layer.state.visible, gradients.means2d, (layer.cover.shape[1], layer.cover.shape[0]))
    rates = rates_at(round(progress * MOST_VISITS), MOST_VISITS, config.learning_rates, 1.0, 0)
    for name in FIELDS:
        parts = (state.gaussians, gradients.parameters, state.first, state.second)
        values, gradient, first, second = (getattr(part, name) for part in parts)
        adam_step(values, gradient, first, second, state.iteration + 1, rates[name])
    return replace(state, iteration=state.iteration + 1)


def grown(state: TrainingState, view: int, config: LayerConfig, seed: int) -> TrainingState:
    """A layer after its step, refined if that is due."""
    if not grow_due(config.growth, state.iteration - 1):
        return state
    return grow(state, config.growth, 1.0, layer_stream(seed, view, state.iteration))


def layer_arrays(state: TrainingState) -> dict[str, NDArray]:
    """All of a layer's state, for checkpoints."""
    parameters = {
        f"{part}.{name}": value for part in PARTS for name, value in getattr(state, part).state_dict().items()
    }
    visits = np.array([state.iteration])
    return {**parameters, "gradient_sum": state.gradient_sum, "seen": state.seen, "visits": visits}


def layer_from(arrays: dict[str, NDArray]) -> TrainingState:
    """The opposite."""
    gaussians, first, second = (
        Gaussians(**{name: arrays[f"{part}.{name}"].copy() for name in FIELDS}) for part in PARTS
    )
    statistics = arrays["gradient_sum"].copy(), arrays["seen"].copy()
    return TrainingState(gaussians, first, second, *statistics, iteration=int(arrays["visits"][0]))
