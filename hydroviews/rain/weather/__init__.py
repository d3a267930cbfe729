"""Weather that is more than rain: haze, a dark afternoon, night with lamps, and a shower that is all of it."""
