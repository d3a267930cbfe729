"""The metrics there are: ours, and those that other packages register as entry points.

A metric of one's own is one file and one line of its package's pyproject.toml:

    [project.entry-points."hydroviews.metrics"]
    mean-error = "my_metrics:MEAN_ERROR"

where MEAN_ERROR is a `Metric`. Scoring, records and tables then have it as they have PSNR.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

from hydroviews.cli.plugins import load_plugin, registered
from hydroviews.errors import InputError
from hydroviews.metrics.inputs import Score
from hydroviews.metrics.lpips import lpips
from hydroviews.metrics.psnr import psnr
from hydroviews.metrics.ssim import ssim

GROUP = "hydroviews.metrics"  # entry points: metrics


@dataclass(frozen=True)
class Metric:
    """One way to compare a render with its ground truth.

    The function is called as `function(image, target, ignored=mask)` with float32 images [H, W, 3] in [0, 1] and a bool
    mask [H, W], true where pixels are hidden, or None. It gives a float, or raises ValueError or InputError where the
    score cannot be had, with the reason.
    """

    name: str  # of a column in records
    title: str  # in tables and sentences
    decimals: int
    higher_is_better: bool
    function: Callable[..., Score]
    unit: str = ""

    def text(self, value: float) -> str:
        """A score as tables show it, without its unit."""
        return f"{value:.{self.decimals}f}"


METRICS = (
    Metric("psnr", "PSNR", 2, True, psnr, unit="dB"),
    Metric("ssim", "SSIM", 4, True, ssim),
    Metric("lpips_alex", "LPIPS", 4, False, partial(lpips, net="alex")),
    Metric("lpips_vgg", "LPIPS-VGG", 4, False, partial(lpips, net="vgg")),
)


@cache
def find_metrics() -> tuple[Metric, ...]:
    """METRICS, then those that are registered, sorted by the names of their entry points.

    Raises:
        InputError: what is registered cannot be imported, is no metric, or has the name of another.
    """
    found = list(METRICS)
    for name, target in registered(GROUP).items():
        metric = load_plugin(f"{GROUP}: {name}", name, GROUP, "metric", "METRIC")
        if not isinstance(metric, Metric):
            raise InputError(f"{GROUP}: {name} = {target} is not a metric", found=metric, expected="a Metric")
        if metric.name in {other.name for other in found}:
            raise InputError(f"{GROUP}: {name} = {target}: there is a metric {metric.name} already")
        found.append(metric)
    return tuple(found)
