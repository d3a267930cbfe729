"""Files hold no Gaussians that are NaN or infinite: no renderer shows those, and a scene would be empty unawares."""

from pathlib import Path

from baselines.splatting.gaussians import Gaussians
from baselines.splatting.state import finite
from hydroviews.errors import InputError


def require_finite(path: Path, gaussians: Gaussians, fix: str) -> Gaussians:
    """The same Gaussians, if all their parameters are finite.

    Args:
        path: of the file that they come from or go to.
        gaussians: what is in it.
        fix: what the user should do about others.

    Raises:
        InputError: some are NaN or infinite; says how many.
    """
    count = int((~finite(gaussians)).sum())
    if count:
        raise InputError(
            f"{path}: Gaussians that are not finite",
            found=f"NaN or infinite parameters in {count:,} of {len(gaussians):,}",
            fix=fix,
        )
    return gaussians
