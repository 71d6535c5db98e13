"""The page: a simulation, its picture and its controls, served to any number of browsers."""

import contextlib
import errno
import queue
import socket
import threading
import time
from typing import Any

import numpy as np
import rich
import viser

from drpbench.errors import InputError

from .drawing import Drawing
from .panel import Panel
from .simulation import Simulation

_FRAME = 1.0 / 30.0  # [s] between two pictures
_SAID = 0.1  # [s] between two readings
NO_SOLUTION = "No joints reach that pose: the goal stays where it is."


class Page:
    """Everything that happens, happens in `run`'s thread; browsers only leave their wishes."""

    def __init__(self, simulation: Simulation, policy: str, host: str, port: int):
        """Serves from now on. Raises InputError where the address is not available."""
        self._simulation, self._episode = simulation, simulation.world.episode
        self._wishes: queue.SimpleQueue[tuple[str, tuple[Any, ...]]] = queue.SimpleQueue()
        self._server = _server(host, port)
        self._drawing = Drawing(self._server, simulation.world.robot, self._dragged)
        self._panel = Panel(self._server, simulation, policy, self._ask)
        self._drawing.handle.on_update(self._goal_dragged)
        self._playing, self._speed, self._note = False, 1.0, ""
        self._owed, self._pace, self._measured = 0.0, 0.0, (time.monotonic(), 0)
        self._stopped_at_end = self._closed = False
        self._begin()

    @property
    def address(self) -> str:
        """What to open in a browser."""
        host = self._server.get_host()
        host = {"0.0.0.0": "localhost", "::": "localhost"}.get(host, host)
        return f"http://{f'[{host}]' if ':' in host else host}:{self._server.get_port()}"

    @property
    def port(self) -> int:
        return self._server.get_port()

    def close(self) -> None:
        """Ends `run`, and lets go of the address and of all browsers."""
        self._closed = True
        # It says goodbye to every browser and waits for each to answer; nobody need wait for that.
        stopping = threading.Thread(target=self._server.stop, daemon=True)
        stopping.start()
        stopping.join(1.0)

    # -- wishes: called from other threads --

    def _ask(self, what: str, *values: Any) -> None:
        self._wishes.put((what, values))

    def _dragged(self, what: str, index: int, place: np.ndarray, let_go: bool) -> None:
        self._ask("drag", what, index, place, let_go)

    async def _goal_dragged(self, event: Any) -> None:
        handle = event.target
        self._ask("goal", handle.position.copy(), handle.wxyz.copy(), event.phase == "end")

    def _obey(self) -> bool:
        """Does what browsers asked for since last time: whether they asked for anything."""
        asked: list[tuple[str, tuple[Any, ...]]] = []
        with contextlib.suppress(queue.Empty):
            while True:
                wish = self._wishes.get_nowait()
                # Of a drag, and of a number that is typed, only the latest counts.
                if asked and asked[-1][0] == wish[0] and wish[0] in ("goal", "open", "speed"):
                    asked.pop()
                asked.append(wish)
        for what, values in asked:
            getattr(self, f"_on_{what}")(*values)
        return bool(asked)

    def _on_play(self) -> None:
        self._playing, self._owed, self._pace = not self._playing, 0.0, 0.0
        self._measured = (time.monotonic(), self._simulation.clock)

    def _on_time(self, what: str) -> None:
        if what == "Reset":
            self._simulation.reset()
            self._begin()
        else:
            self._playing = False
            for _ in range(1 if what == "Step" else 10):
                self._simulation.step()

    def _on_speed(self, speed: float) -> None:
        self._speed = float(speed)

    def _on_open(self, id: int) -> None:
        if 0 <= id < self._simulation.problems.count and id != self._simulation.id:
            self._simulation.open(id)
            self._begin()

    def _on_turn(self, by: int) -> None:
        self._on_open((self._simulation.id + by) % self._simulation.problems.count)

    def _on_boxes(self, remove: bool) -> None:
        self._note = ""
        if remove:
            self._simulation.remove_boxes()
        elif self._simulation.add_box() is None:
            self._note = "There is no room for another box."
        self._redraw()

    def _on_show(self, what: str, on: bool) -> None:
        if what == "handle":
            self._drawing.handle.visible = on
        else:
            setattr(self._drawing, f"{what}_shown", on)

    def _on_drag(self, what: str, index: int, place: np.ndarray, let_go: bool) -> None:
        self._note = ""
        self._simulation.move(what, index, place, hold=not let_go, at_once=not self._playing)

    def _on_goal(self, position: np.ndarray, quaternion: np.ndarray, let_go: bool) -> None:
        moved = self._simulation.move_goal(position, quaternion)
        self._note = "" if moved else NO_SOLUTION
        if let_go and not moved:
            self._drawing.put_handle(self._simulation.look())

    # -- the course of time --

    def _begin(self) -> None:
        """Another scene, or the same from its start."""
        self._note, self._owed, self._stopped_at_end = "", 0.0, False
        self._measured = (time.monotonic(), 0)
        self._panel.say_problem(self._simulation.id)
        self._redraw()

    def _redraw(self) -> None:
        self._drawing.begin(self._simulation.furniture, self._simulation.look())

    def run(self) -> None:
        """Goes on until it is closed or interrupted."""
        drawn = said = 0.0
        last, stale = time.monotonic(), False
        while not self._closed:
            began = time.monotonic()
            stale |= self._obey() or self._playing
            if self._playing:
                self._play(began, began - last)
            last = began
            if stale and began - drawn >= _FRAME:
                simulation = self._simulation
                self._drawing.show(simulation.look(), simulation.furniture, simulation.touching)
                drawn, stale = began, False
            if began - said >= _SAID:
                self._say()
                said = began
            time.sleep(max(0.001, self._episode.period / 2 - (time.monotonic() - began)))

    def _play(self, now: float, passed: float) -> None:
        """The control steps that are due, as far as there is time for them."""
        due = self._owed + passed * self._speed / self._episode.period
        while due >= 1.0 and time.monotonic() - now < _FRAME:
            self._simulation.step()
            due -= 1.0
            if self._simulation.clock == self._episode.steps and not self._stopped_at_end:
                self._playing, self._stopped_at_end = False, True  # to let the verdict be read
                break
        self._owed = min(due, 1.0)  # what there was no time for is not made up for

    def _say(self) -> None:
        began, clock = self._measured
        now, moment = time.monotonic(), self._simulation.look()
        if now - began >= 0.5:
            self._pace = (
                max(0, self._simulation.clock - clock) * self._episode.period / (now - began)
            )
            self._measured = (now, self._simulation.clock)
        self._panel.say(self._simulation, moment, self._playing, self._pace, self._note)


def _server(host: str, port: int) -> viser.ViserServer:
    """viser's server, without its words, at the port or, where that is taken, the next free one."""
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[
            0
        ]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(place)
    except OSError as error:
        if error.errno != errno.EADDRINUSE:
            raise InputError(
                f"--host {host} --port {port}: not available ({error.strerror or error}); "
                f"--host 127.0.0.1 with a port above 1023 usually can"
            ) from None
    rich.get_console().quiet = True  # viser's; the command line has one of its own
    server = viser.ViserServer(host=host, port=port, verbose=False)
    # viser could lend its page to the world through a server of its makers. Not this one.
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]
    return server
