"""The catalogue of published captures, and suites of them."""
