"""The rain between a scene and its photographs, learned while the scene is learned.

A rendered view B [H, W, 3], sRGB-encoded, is seen through three layers, each with a share alpha of a pixel's light
that it blocks, in [0, 1]:

    R = (1 - S - D) B + (S + D) beta                                falling rain, encoded values
    T = encode((1 - V) decode(R) + V a)                             mist on the lens, linear light
    O = (1 - M) T + M C + L                                         drops on the lens, encoded values

S is the median rain_alpha, and D the deviation of a view's single streaks from S, of either sign. V is mist_alpha, on a
coarse grid of the lens, and a the light of the mist. M is drop_alpha of every pixel of the lens, C the mean light
around the pixel, and L the drop's own light. The training minimises one objective over views v and pixels x, with the
photographs I:

    sum (1 - r) (1 - M) rho(I - O)                          the photograph, through the rain
    + lambda(t) c sum (1 - r) (1 - M) rho(E - B_left)       the enhanced photograph E
    + prior(V) + prior(a)                                   what photographs cannot show

    r = P(a drop hides the pixel | network, lens)

rho is the photometric loss (L1 and SSIM). B_left is B behind the mist that E still has: the part of V beyond the mist
that the network removes, its error included. lambda falls from 1 to 0. c is the share of the network's change of a
photograph that is not the network's own expected error. Each step uses one of the first two terms: the second one with
the probability lambda c. M and L follow in closed form from running means over photographs and renders, S and D from
photographs and E. A network predicts E, its error, the covers in r, and a part of prior(V). Without a network, M, L, V
and a are left.

Some views are kept from the scene at first, and a layer's gain is how much better it predicts them. Drops are left out
for the rest of the training if their gain is below 2 standard errors, mist if its gain is below -2. Falling rain, which
no other view predicts, counts if its mean cover in the network's pictures is large enough.

    config.py             all settings
    objective.py          RainObjective: the steps, the enhanced photographs, the trial of the layers
    model.py              RainModel: the layers one after another, forward, backward and update
    occlusion.py          r
    drops.py              M and L, by lines in which photographs follow renders
    mist.py               V and a, by Adam
    rainfall.py           S and D
    kernels.py            the layers' formulas and gradients on a CPU; on_gpu.py: the same where a GPU renders

What photographs of one lens show before any training is in `deraings.lens`.
"""
