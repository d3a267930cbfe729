"""Rain: what is drawn, what it adds to a view, and the rainy view that results."""
