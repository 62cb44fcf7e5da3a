"""Dojo (Howell et al. 2022, arXiv:2203.00806): a Julia package, whose Python wrapper dojopy needs Julia."""

from mjhcmc.engines.base import Engine

ENGINE = Engine(
    "Dojo", "dojo",
    missing="a Julia package, its wrapper dojopy is not on PyPI: it takes Julia, Dojo.jl, the wrapper, and an adapter",
)  # fmt: skip
