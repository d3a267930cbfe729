"""What photographs of one lens show of the lens, before any training.

views.py          which photographs one lens took, and means over the views before and after
time_knots.py     how what is on the lens changes from view to view
fixed_pattern.py  detail that stays on the lens while the scene moves
still_pixels.py   pixels that hardly change from view to view
mist_bounds.py    the most that mist can be, and its light
paleness.py       mist on the lens or fog in the scene, by scene points
mist_prior.py     the mist that is to be expected, and how surely
"""
