"""Settings of mist on the lens: what it can be, when it is believed, how it is learned."""

from dataclasses import dataclass


@dataclass(frozen=True)
class VeilConfig:
    """How mist is looked for and learned."""

    cells: int = 12  # of the grid along the longer side
    views_a_moment: int = 12  # no moment of the film is told from fewer views
    most_moments: int = 3
    start: float = 0.03  # share of the iterations before it
    likely: float = 0.7  # V at the start over the thickest possible, less what is possible everywhere
    slack: float = 1.3  # factor by which V may be thicker than `mist_bounds` says
    brightest: float = 0.1  # share of the pixels, the brightest, whose light is expected of the mist
    tint: float = 0.3  # share of their colour that it has
    rate: float = 1e-2  # Adam's, of sqrt(V)
    colour_rate: float = 1e-3
    final: float = 0.1  # what the rates have fallen to at the end, as a factor
    penalty: float = 1e-3  # factor of the mean of V in the loss
    roughness: float = 0.01  # of the mean of the knots' squared differences to their neighbours, in sqrt(V)
    colour_penalty: float = 0.1  # of the squared difference of a to what is expected
    thickest: float = 0.95
    darkest: float = 0.05  # quantile of what a place of the lens shows that mist cannot be lighter than
    thinnest: float = 0.01  # lower quartile over the lens of what mist may be there, from which it is looked for
    shown: float = 0.05  # share of the mist that may be there that scene points must show at least
    foggy: float = 0.15  # share of their contrast that scene points lose over the median depth, from which it is foggy
    evenness: float = 3.0  # V is at most so many times the median over the lens of what may be there
