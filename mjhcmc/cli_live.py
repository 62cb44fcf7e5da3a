"""The command ``mjhcmc live``."""

from __future__ import annotations

import click

from mjhcmc.cli_support import VERBOSE, engine_notices, told


@click.command("live")
@click.option("--model", default="leg8", show_default=True, metavar="MODEL", help="A shipped model, or a file.")
@click.option("--dt", default=0.01, show_default=True, help="Control window, s.")
@click.option("--physics-dt", default=0.001, show_default=True, help="Largest physics step, s.")
@click.option("--port", type=click.IntRange(0, 65535), default=8080, show_default=True, help="0: any that is free.")
@click.option(
    "--host", default="127.0.0.1", show_default=True, metavar="ADDRESS",
    help="Address to listen on; 0.0.0.0 lets others on the network in, and asks for no password.",
)  # fmt: skip
@click.option("--no-open", is_flag=True, help="Do not open the page: only say where it is.")
@VERBOSE
def live(model: str, dt: float, physics_dt: float, port: int, host: str, no_open: bool, verbose: int) -> int:
    """Drag a movement or a stretch reflex on a page, and see the excitations that follow.

    A slider for each joint's amplitude, the period, and a patient's reflex: HCMC solves again as you drag. Ctrl-C
    ends it. Needs the extra view: pip install "mjhcmc[view]".

    Example: mjhcmc live --model leg8
    """
    click.get_current_context().with_resource(told(verbose))
    from mjhcmc.viewing.live import live_page

    click.get_current_context().with_resource(engine_notices())
    live_page(model, dt=dt, physics_dt=physics_dt, port=port, host=host, open_browser=not no_open, say=click.echo)
    return 0
