"""A network that is trained and run in no time."""

from dataclasses import replace

from deraings.enhancement.architecture.network import SMALL

TINY = replace(
    SMALL,
    width=8,
    encoder=(1, 1, 1, 1),
    bottleneck=1,
    decoder=(1, 1, 1, 1),
    head_width=8,
    cover=(4, 8),
    error=False,
    mist=8,
    lens_mist=True,
    lens_fine=True,
)
