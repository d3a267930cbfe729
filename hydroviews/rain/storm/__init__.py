"""A storm: drops in space, hidden by what is nearer, lit by what is around them."""
