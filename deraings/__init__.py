"""DeRainGS, the method the benchmark is named after. Nothing is registered here yet."""
