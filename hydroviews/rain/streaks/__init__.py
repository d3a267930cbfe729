"""Rain streaks by the paper's recipe: motion-blurred noise."""
