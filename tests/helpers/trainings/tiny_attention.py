"""Raindrop attention networks that are trained and run in no time."""

from baselines.derain_nerf.raindrop_attention.config import (
    DiscriminatorConfig,
    GeneratorConfig,
    LossConfig,
    TrainingConfig,
)

GENERATOR = GeneratorConfig(
    iterations=2, attention_width=8, attention_blocks=1, attention_stride=2, width=8, residual=True
)
DISCRIMINATOR = DiscriminatorConfig(stride=4, widths=(4, 8), reduced=(8,), pooled=2, hidden=8)
TRAINING = TrainingConfig(
    generator=GENERATOR,
    discriminator=DISCRIMINATOR,
    losses=LossConfig(perceptual="alex", perceptual_weight=0.05),
    steps=6,
    patch=48,
    crops=2,
    batch=1,
    rate=1e-3,
    warm_up=2,
)
