"""``mjhcmc check``: what the package sees in a model, and every problem with its remedy."""
