"""DeRainGS, the method the benchmark is named after, and its continuation that models the rain."""
