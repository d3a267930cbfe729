"""What falls between the scene and the photograph, learned while the scene is learned.

A rendered view B [H, W, 3], sRGB-encoded, is seen through falling rain, then through mist on the lens, then through
drops on the lens:

    R = (1 - rain_alpha) B + rain_alpha beta                                      falling rain, encoded values
    T = encode((1 - mist_alpha) decode(R) + mist_alpha a)                         mist, linear light
    O = (1 - drop_alpha) T + L                                                    drops, encoded values

`alpha` is everywhere the share of a pixel's light that is blocked, in [0, 1]; what lies behind keeps 1 - alpha. The
papers and the layers of a built data set write S + D for rain_alpha (S even, D of single streaks), V for mist_alpha, M
for drop_alpha.

    model.py           RainModel, all of it: `forward` gives O, `backward` the gradients, `update` learns of the rain
    mist.py            mist_alpha on a coarse grid, and a; mist_config, mist_bounds, mist_or_fog, mist_kernels beside it
    drops.py           drop_alpha and L of every pixel of the lens; drops_kernels, fixed_pattern beside it
    renewed_drops.py   which pixels drops hide that are new in every view
    falling_rain.py    S and D together, and when they are learned
    rain_layer.py      S, one number a scene; streak_statistics (whether it rains at all, how much), rain_kernels
    streaks.py         D, of every pixel of every view
    layer_kernels.py   views behind rain and drops, and the gradient back
    warm_up.py         all kernels, compiled and loaded
    time_knots.py      how mist and drops change from view to view
    observation.py     a photograph, and which of its pixels count
    enhanced_target.py where the scene is learned from enhanced photographs as well
    objective.py       RainObjective, the photometric loss of O against the photograph
    report.py          what was found, for a run's record

Every part switches itself on only where the photographs call for it, and can be left out: see `model.RainConfig`.
"""
