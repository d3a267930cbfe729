"""How the time of a step grows, as curves."""

import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from benchmarks.splatting.speed import SIZES

COLOURS = {"step": "#1f4e79", "raster": "#c55a11", "loss": "#548235"}
DASHES = {1: "dash", 2: "solid"}  # by threads


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
            count = int(str(threads))
            for part, colour in COLOURS.items():
                name = f"{part}, {count} thread{'s' if count > 1 else ''}"
                figure.add_trace(
                    go.Scatter(
                        x=chosen[by],
                        y=chosen[part],
                        name=name,
                        legendgroup=name,
                        showlegend=column == 1,
                        line={"color": colour, "dash": DASHES.get(count, "dot")},
                    ),
                    1,
                    column,
                )
    figure.update_xaxes(type="log", dtick=1).update_yaxes(type="log", dtick=1).update_yaxes(title_text="ms", col=1)
    figure.update_layout(template="plotly_white", width=900, height=420, margin={"t": 50, "b": 40})
    return str(figure.to_html(include_plotlyjs=True, full_html=True))
