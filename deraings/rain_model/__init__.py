"""A model of the rain itself: mist and drops on the lens, falling rain, single streaks."""
