"""The training of radiance fields: batches of rays, Adam, its rates. Model and loss are the method's."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from baselines.training.checkpoints import CHECKPOINT, Tree, fingerprint_of, settings_of
from baselines.training.devices import chosen_device
from baselines.training.images import TrainingImages, read_images
from baselines.training.loop import Metrics, run
from baselines.training.torch_state import module_arrays, restore_module
from baselines.volumetric.config import MlpFieldConfig, VolumetricConfig
from baselines.volumetric.fields.hash_grid import warm_up as warm_up_kernels
from baselines.volumetric.losses import Loss, photometric_losses
from baselines.volumetric.model import RadianceModel, TrainingContext
from baselines.volumetric.rays.batches import Batch, Draw, TrainingPixels
from baselines.volumetric.rays.sampling import annealed
from baselines.volumetric.rays.spaces import Space, choose_space
from hydroviews.scene.scenes import Scene
from hydroviews.scene.seeds import generator

BETAS, EPSILON = (0.9, 0.99), 1e-15  # of Mueller et al. 2022: entries that are rarely seen still move
PROPOSAL_EVERY = 4  # steps between two trainings of a proposal network once proposals are sharp
Make = Callable[[Space, torch.Generator, int], RadianceModel]  # space, start, number of training views


@dataclass(frozen=True)
class TrainedField:
    """A trained radiance field."""

    model: RadianceModel
    seconds: float  # of training alone, over all sessions
    device: str


def train(
    scene: Scene,
    config: VolumetricConfig,
    seed: int,
    folder: Path,
    make: Make,
    loss: Loss | None = None,
    *,
    settings: Mapping[str, Any] | None = None,
    images: TrainingImages | None = None,
    weights: Sequence[NDArray[np.float32]] | None = None,
    draw: Draw = TrainingPixels.draw,
) -> TrainedField:
    """Learn the scene's training views, or go on from the checkpoint in `folder`.

    A run that was interrupted and goes on ends with the same bits as one that was not, on the CPU and with
    the same number of threads.

    Args:
        scene: training views and points.
        config: settings of rendering and training.
        seed: of everything random.
        folder: where the checkpoint is kept.
        make: the model, untrained.
        loss: of a batch; by default that of a plain field.
        settings: of the whole method, for JSON; those of `config` by default. Checkpoints of others are refused.
        images: to learn from instead of the photographs.
        weights: how much each pixel counts, [H, W] in [0, 1] a view.
        draw: the pixels of a step; by default evenly from all views.

    Raises:
        InputError: no training views; an image that cannot be read; weights of another size; a checkpoint of another
            configuration, seed or scene; no such device.
        FloatingPointError: a loss is NaN or infinite.
        KeyboardInterrupt, SystemExit: on Ctrl-C and SIGTERM, after a checkpoint was written.
    """
    cameras = [view.camera for view in scene.train_views]
    space = choose_space(cameras, scene.points)
    device = torch.device(chosen_device(config.device))
    pixels = TrainingPixels(cameras, images or read_images(scene.train_views), weights)
    start = generator(seed, "start").integers(2**62)
    model = make(space, torch.Generator().manual_seed(int(start)), len(cameras))
    model.prepare(pixels.images)
    model = model.to(device)
    if device.type == "cpu":
        warm_up_kernels()
    else:
        torch.set_float32_matmul_precision("high")  # TF32, with which fields train as well and several times faster
    fingerprint = fingerprint_of(
        settings or settings_of(config), seed, scene, pixels.images, weights=pixels.digest(), device=device.type
    )
    trainer = FieldTrainer(config, seed, pixels, model, loss or photometric_losses(config), device, draw)
    run(trainer, folder / CHECKPOINT, fingerprint, config.checkpoint_seconds)
    model.finish()
    return TrainedField(model, trainer.seconds, torch.cuda.get_device_name() if device.type == "cuda" else "cpu")


class FieldTrainer:
    """A radiance field that learns pixels of the training views; see `baselines.training.loop.Trainer`."""

    def __init__(
        self,
        config: VolumetricConfig,
        seed: int,
        pixels: TrainingPixels,
        model: RadianceModel,
        loss: Loss,
        device: torch.device,
        draw: Draw = TrainingPixels.draw,
    ) -> None:
        """Begin with a model, untrained and on the device; `seed` is that of rays and samples."""
        self.config, self.seed, self.pixels = config, seed, pixels
        self.model, self.loss, self.device, self.draw = model, loss, device, draw
        self.optimiser = torch.optim.Adam(model.groups(), betas=BETAS, eps=EPSILON, fused=True)
        self.rates = [group["lr"] for group in self.optimiser.param_groups]  # before schedule
        self.iterations, self.iteration, self.seconds = config.iterations, 0, 0.0

    @property
    def finished(self) -> bool:
        """Whether no step is left."""
        return self.iteration >= self.iterations

    def step(self) -> Metrics:
        """Learn from one batch of rays; returns its losses."""
        for group, rate in zip(self.optimiser.param_groups, self.rates, strict=True):
            group["lr"] = rate * rate_at(self.iteration, self.config)
        batch = self.draw(self.pixels, self.seed, self.iteration, self.config.rays, self.model.space, self.device)
        rendering = self.model(batch.rays, self._training_context(batch))
        losses = self.loss(rendering, batch)
        stacked = torch.stack(list(losses.values()))
        self.optimiser.zero_grad()
        stacked.sum().backward()
        self.optimiser.step()
        self.model.after_step(rendering, batch)
        self.iteration += 1
        return dict(zip(losses, stacked.tolist(), strict=True))

    def state_dict(self) -> Tree:
        """The model and Adam's moments, and how far training is."""
        model = module_arrays(self.model, self.optimiser)
        return {"iteration": self.iteration, "seconds": self.seconds, "model": model}

    def load_state_dict(self, tree: Tree) -> None:
        """Take over what `state_dict` gave."""
        restore_module(self.model, tree["model"], self.optimiser)
        self.iteration, self.seconds = tree["iteration"], tree["seconds"]

    def _training_context(self, batch: Batch) -> TrainingContext:
        """What the step's rendering depends on: the views, jitter, and how far training is."""
        config, iteration = self.config, self.iteration
        numbers = generator(self.seed, "jitter", iteration).random((2, config.rays), np.float32)
        jitter = torch.from_numpy(numbers).to(self.device)
        coarse = isinstance(config.field, MlpFieldConfig)  # whose colours are learned from in every step, as in NeRF
        update_proposal = coarse or iteration < config.anneal or iteration % PROPOSAL_EVERY == 0
        return TrainingContext(
            batch.views,
            jitter,
            annealed(iteration, config.anneal),
            update_proposal,
            batch.places,
            progress=iteration / config.iterations,
        )


def rate_at(iteration: int, config: VolumetricConfig) -> float:
    """Share of the learning rate: rises linearly, falls exponentially."""
    rising = min(1.0, (iteration + 1) / config.warm_up) if config.warm_up else 1.0
    return float(rising * config.final_rate ** (iteration / config.iterations))
