"""The numbers that the paper published: DeRainGS (Liu et al., AAAI 2025, arXiv:2408.11540), tables 1 to 3.

They stand beside ours in columns of their own and are never part of a mean.
"""

from functools import cache
from pathlib import Path

import pandas as pd

# Ours by the paper's rows (b) to (f) of table 3.
ABLATION = (
    "3dgs",
    "deraings.method:Masks",
    "3dgs+enhance",
    "deraings.method:WithoutAttention",
    "deraings",
)
IN_CSV = {name: f"paper_{name}" for name in ("psnr", "ssim", "lpips", "failed")}  # columns beside ours
NOTE = (
    "(paper): numbers of the publication, tables 1 to 3 of arXiv:2408.11540. They are not our runs. They differ in the "
    "rain, which we draw anew, and in image sizes, training lengths and network weights; only the profile `paper` "
    "comes near to these. The paper does not state the network of LPIPS or the window of SSIM. Underlined: the paper "
    "reports failures."
)


@cache
def published() -> pd.DataFrame:
    """The three tables: table, paper_scene, scene, effect, paper_method, method, psnr, ssim, lpips, failed.

    `scene` and `method` are ours; a scene is empty where the paper does not say which of ours it is, and in table 3,
    which is over several.
    """
    path = Path(__file__).with_name("published.csv")
    text = dict.fromkeys(("paper_scene", "scene", "effect", "paper_method", "method", "failed"), str)
    found = pd.read_csv(path, converters=text)
    return found.assign(failed=found.failed == "yes")


def published_scores(scene: str, effect: str) -> pd.DataFrame:
    """Of a scene under an effect: a row a method of ours, columns psnr, ssim, lpips, failed; may be empty."""
    rows = published()
    rows = rows[(rows.scene == scene) & (rows.effect == effect) & (rows.scene != "")]
    return rows.set_index("method")[["psnr", "ssim", "lpips", "failed"]]


def beside_ours(scenes: pd.DataFrame) -> pd.DataFrame:
    """Rows with `scene`, `effect` and `method`, and what was published of each as IN_CSV names it, or nothing."""
    rows = published()
    rows = rows[rows.scene != ""].rename(columns=IN_CSV)
    return scenes.merge(rows[["scene", "effect", "method", *IN_CSV.values()]], how="left")


def published_ablation() -> pd.DataFrame:
    """Table 3: a row a method of ours, columns paper_method, psnr, ssim."""
    rows = published()
    return rows[rows.table == 3].set_index("method")[["paper_method", "psnr", "ssim"]]
