"""How the time of a step grows, as curves."""

import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from benchmarks.splatting.speed import SIZES

SHOWN = ("step", "raster", "loss")


def growth_curves(table: pd.DataFrame) -> str:
    """An HTML page: milliseconds over Gaussians and over pixels, a line a part and number of threads."""
    sizes = table["size"].str.split("x", expand=True).astype(int)
    table = table.assign(pixels=sizes[0] * sizes[1])
    usual = f"{SIZES[0][0]}x{SIZES[0][1]}"
    over = {
        f"Gaussians, {usual}": ("gaussians", table[table["size"] == usual]),
        "pixels, 30,000 Gaussians": ("pixels", table[table.gaussians == 30_000]),
    }
    figure = make_subplots(1, len(over), subplot_titles=[f"over {name}" for name in over])
    for column, (by, rows) in enumerate(over.values(), start=1):
        for threads, chosen in rows.sort_values(by).groupby("threads"):
            for part in SHOWN:
                name = f"{part}, {threads} thread{'s' if int(str(threads)) > 1 else ''}"
                line = go.Scatter(x=chosen[by], y=chosen[part], name=name, legendgroup=name, showlegend=column == 1)
                figure.add_trace(line, 1, column)
    figure.update_xaxes(type="log").update_yaxes(type="log", title_text="ms", col=1)
    return str(figure.to_html(include_plotlyjs=True, full_html=True))
