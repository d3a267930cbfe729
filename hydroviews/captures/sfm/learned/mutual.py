"""Rows and columns of a table of scores that are each other's best."""

import torch
from torch import Tensor


def mutual_best(scores: Tensor, least: float) -> tuple[Tensor, Tensor]:
    """Indices [M] of rows, ascending, and of the columns that are each other's best with more than `least`.

    Args:
        scores: [K, L], at least one row and one column.
        least: score.
    """
    best, partner = scores.max(1)
    mutual = scores.argmax(0)[partner] == torch.arange(len(partner), device=partner.device)
    rows = torch.nonzero(mutual & (best > least))[:, 0]
    return rows, partner[rows]
