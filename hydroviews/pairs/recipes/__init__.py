"""Rain by other recipes than the data set's, so that networks learn what recipes have in common.

* `compositing`: the values in which rain is mixed with a picture.
* `fields`: smooth noise, and planes for half the size.
* `mist`: mist of any form and colour, and places that drops have wiped.
* `shapes`: outlines and places of drops.
* `stamps`: drops on a grid of pixels.
* `drops`: light and focus of drops.
* `panes`: mist and drops together.
* `lines`: streaks.

Every choice that an author of a generator makes is drawn anew for each pair. All ranges are wide: none is fitted to any
data set. Planes are float32 [H, W].
"""
