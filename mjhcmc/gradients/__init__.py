"""Derivatives of solutions: through every window's step and through the allocation, exact at fixed active sets."""
