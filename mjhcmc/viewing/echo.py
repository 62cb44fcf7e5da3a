"""Waiting until a browser has taken in what was sent to it.

viser tells nobody when a message has arrived. A browser answers when it is asked for an item of its storage, though; it
takes messages in order, and answers as it draws its next picture. So an answer means: what was sent before is drawn.
"""

from __future__ import annotations

import time
from typing import Any

_KEY = "mjhcmc"  # nothing is stored there; that it answers is what counts


def echo(client: Any, timeout: float) -> float | None:
    """s until a browser has drawn what was sent to it before, and its answer is here; None where there is no answer.

    Args:
        client: a ``viser.ClientHandle``.
        timeout: s to wait at most.
    """
    began = time.perf_counter()
    try:
        client.local_storage.get_item(_KEY, timeout=timeout)
    except TimeoutError:
        return None
    except RuntimeError as error:
        if "disconnected" in str(error):
            return None  # otherwise its storage is shut, which is an answer, too
    return time.perf_counter() - began
