"""Whether a method keeps the contract of `baselines.method.Method`, seen on a room that is learned in seconds."""
