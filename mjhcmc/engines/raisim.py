"""RaiSim (Hwangbo et al. 2018, doi 10.1109/LRA.2018.2792536): closed source, runs with an activation key."""

from mjhcmc.engines.base import Engine

ENGINE = Engine(
    "RaiSim", "raisim",
    missing="closed source, not on PyPI: it takes raisimLib with raisimPy, a license's activation key, and an adapter",
)  # fmt: skip
