"""Image quality, one file a metric: images [H, W, 3] or batches [N, 3, H, W], values in [0, 1].

An image pair gives a float, a pair of batches a tensor [N]. `METRICS` lists ours, `find_metrics` all there are.
Torch is imported when the first score is calculated: what only names metrics does without.
"""

from hydroviews.metrics.lpips import lpips
from hydroviews.metrics.psnr import psnr
from hydroviews.metrics.registry import METRICS, Metric, find_metrics
from hydroviews.metrics.ssim import ssim

__all__ = ["METRICS", "Metric", "find_metrics", "lpips", "psnr", "ssim"]
