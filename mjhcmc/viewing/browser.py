"""A solution in the browser: the replay in three dimensions, muscles coloured by activation, curves beside it."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

from mjhcmc.viewing.frames import Frames
from mjhcmc.viewing.server import serve, start_server, stop_server, url_of

if TYPE_CHECKING:
    from mjhcmc.solution import Solution

HOST, PORT = "127.0.0.1", 8080

_FPS = 120.0  # frames a second of the motion, at most: speeds below 1 stay smooth


class BrowserPage:
    """A page that is being served. Build it with `view_in_browser`.

    Attributes:
        server: the ``viser.ViserServer``.
        player: plays the frames.
        charts: the curves.
    """

    def __init__(self, solution: Solution, host: str, port: int) -> None:
        frames = Frames.of(solution, fps=min(_FPS, 1.0 / solution.dt))  # before the server: bad input is found first
        from mjhcmc.viewing.charts import Charts
        from mjhcmc.viewing.player import Player

        self.server = start_server(host, port)
        try:
            style(self.server, "replay")
            self.player = Player(self.server, frames)
            gui = self.server.gui
            look = "font-size:13px;padding:2px 12px;overflow-wrap:anywhere"
            gui.add_html(f'<div style="{look}">{escape(frames.title)}</div>')
            with gui.add_folder("Replay"):
                self.player.add_playback()
            with gui.add_folder("Muscles"):
                self.player.add_muscles()
            self.charts = Charts(self.server, solution)
        except BaseException:
            stop_server(self.server)
            raise
        self.player.start()

    @property
    def url(self) -> str:
        """Where the page is."""
        return url_of(self.server)

    def close(self) -> None:
        """End the page."""
        self.player.close()
        stop_server(self.server)


def view_in_browser(
    solution: Solution,
    *,
    port: int = PORT,
    host: str = HOST,
    open_browser: bool = True,
    block: bool = True,
    say: Callable[[str], None] = print,
) -> BrowserPage:
    """Replay a solution on a page in the browser (extra ``view``).

    Muscles have the colour of their activation, the desired motion is a ghost whose distance can be magnified, and
    curves of excitations, joints and moments are beside it. Any number of browsers may look at once; all see the same
    time.

    Args:
        solution: with its model.
        port: of the page; 0: any that is free.
        host: to listen on. The default is reached from this machine only; nothing asks for a password.
        open_browser: open the page.
        block: wait for Ctrl-C. Otherwise return at once; `BrowserPage.close` ends the page.
        say: prints the line with the address.

    Returns:
        The page.

    Raises:
        SettingsError: viser is not installed, the port is taken, or the host is not this machine's.
        SimulationError: the solution does not know its model.
    """
    page = BrowserPage(solution, host, port)
    serve(page.server, "replay", open_browser=open_browser, block=block, say=say, close=page.player.close)
    return page


def style(server: Any, title: str) -> None:
    """What pages have in common: light, no logo, no button that would share them with the world."""
    server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
    server.gui.set_panel_label(f"mjhcmc: {title}")
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(330)
    scene = server.scene  # shadows and mirrored surroundings take most of a picture's time where there is no GPU
    scene.configure_environment_map(None)
    scene.configure_default_lights(cast_shadow=False)
    scene.add_light_hemisphere("/sky", sky_color=(255, 255, 255), ground_color=(200, 197, 192), intensity=1.8)
