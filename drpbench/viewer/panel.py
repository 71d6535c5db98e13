"""The controls beside the picture, and what they say."""

from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np
import viser

from .moment import Moment
from .simulation import Simulation

_RED, _GREEN, _GREY, _AMBER = "#c8141e", "#14803c", "#5b6470", "#9a5b00"
_RULES = """\
Drag a piece of furniture or a box with the mouse; it moves in the plane of the screen, and while the world runs it \
follows at 1 m/s. A box that drifts drifts on from where you let it go. The table stays. Drag the handle to move the \
goal. The background turns the view, the right button shifts it.
"""


def named(link: str) -> str:
    """A link as one says it."""
    return link.replace("_", " ")


Ask = Callable[..., None]
"""Is told by name and values what the user wants."""


class Panel:
    """Buttons, numbers and the verdict so far. `ask(name, *values)` is told what the user wants."""

    def __init__(
        self, server: viser.ViserServer, simulation: Simulation, policy: str, ask: Ask
    ) -> None:
        gui, count = server.gui, simulation.problems.count
        self._ask, self._policy = ask, policy
        self._world, self._families = simulation.world, simulation.problems.family
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(32, 92, 200))
        gui.set_panel_label("drpbench view")
        self._verdict = gui.add_html("")
        self._play = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
        self._play.on_click(lambda _: ask("play"))
        steps = gui.add_button_group("Time", ("Step", "10 steps", "Reset"))
        steps.on_click(lambda event: ask("time", event.target.value))
        speed = gui.add_slider("Speed", min=0.1, max=4.0, step=0.1, initial_value=1.0)
        speed.on_update(lambda event: ask("speed", event.target.value))
        self._number = gui.add_number("Problem", 0, min=0, max=count - 1, step=1)
        self._number.on_update(self._typed)
        turn = gui.add_button_group(" ", ("Previous", "Next"))
        turn.on_click(lambda event: ask("turn", 1 if event.target.value == "Next" else -1))
        boxes = gui.add_button_group("Boxes", ("Add a box", "Remove"))
        boxes.on_click(lambda event: ask("boxes", event.target.value == "Remove"))
        with gui.add_folder("Show", expand_by_default=False):
            self._choice(gui, "Point cloud", "cloud", True)
            self._choice(gui, "Goal", "ghost", True)
            self._choice(gui, "Goal's handle", "handle", True)
            if simulation.reacts:
                self._choice(gui, "DCP-RMP's goal (violet)", "reaction", True)
        with gui.add_folder("How to", expand_by_default=False):
            gui.add_markdown(_RULES)
        self._playing: bool | None = None

    def _typed(self, event: Any) -> None:
        """A number was entered in a browser; one that `say_problem` sets has no client."""
        if event.client is not None:
            self._ask("open", int(event.target.value))

    def _choice(self, gui: Any, label: str, name: str, on: bool) -> None:
        box = gui.add_checkbox(label, on)
        box.on_update(lambda event: self._ask("show", name, event.target.value))

    def say_problem(self, id: int) -> None:
        """Another problem is open."""
        if self._number.value != id:
            self._number.value = id  # type: ignore[misc]

    def say(
        self, simulation: Simulation, moment: Moment, playing: bool, pace: float, note: str
    ) -> None:
        """The state of things. `pace` is how fast time goes, 1 in real time; `note` one line
        more."""
        if playing != self._playing:
            self._playing = playing
            self._play.label = "Pause" if playing else "Play"
            icons = viser.Icon
            self._play.icon = icons.PLAYER_PAUSE if playing else icons.PLAYER_PLAY
        text = self._text(simulation, moment, playing, pace, note)
        if text != self._verdict.content:
            self._verdict.content = text

    def _text(
        self, simulation: Simulation, moment: Moment, playing: bool, pace: float, note: str
    ) -> str:
        clearance, position = float(moment.clearance), float(moment.position_error)
        turn = float(np.degrees(moment.orientation_error))
        task, robot, episode = self._world.task, self._world.robot, self._world.episode
        seconds, whole = simulation.clock * episode.period, episode.steps * episode.period
        time = f"{seconds:.2f} s of {whole:.1f} s"
        if playing:
            time += f" &nbsp;(x {pace:.1f})"
        room = f"{100 * clearance:.1f} cm, {named(robot.link_names[moment.link])}"
        family = self._families[simulation.id].replace("_", " ")
        rows = [
            ("time", time, _GREY),
            ("clearance", room, _RED if clearance < 0.0 else _GREY),
            ("to the goal", f"{100 * position:.1f} cm, {turn:.0f}°", _GREY),
        ]
        lines = "".join(
            f'<div style="display:flex;justify-content:space-between"><span>{name}</span>'
            f'<span style="color:{color};font-variant-numeric:tabular-nums">{value}</span></div>'
            for name, value, color in rows
        )
        word, color = self._word(simulation, moment)
        small = [note] if note else []
        if simulation.edited:
            small.append("Changed by hand: no episode of the benchmark any more.")
        notes = "".join(
            f'<div style="font-size:0.85em;color:{_AMBER}">{escape(line)}</div>' for line in small
        )
        return (
            f'<div style="padding:0.4em 1em 0.3em;font-size:0.9em;line-height:1.5">'
            f"<div>{task.name} {simulation.id} with {escape(self._policy)}</div>"
            f'<div style="color:{_GREY}">{escape(family)}, {escape(task.title)}</div>'
            f'<div style="font-weight:600;color:{color}">{escape(word)}</div>{lines}{notes}</div>'
        )

    def _word(self, simulation: Simulation, moment: Moment) -> tuple[str, str]:
        """The verdict line, and its colour."""
        verdict = simulation.verdict
        if simulation.failure:
            return f"The policy failed: {simulation.failure}", _RED
        if not verdict.finite:
            return "The policy's answer, or the arm, is not a number", _RED
        over = simulation.clock >= self._world.episode.steps
        touched = "No contact"
        if verdict.collided:
            when = verdict.first_collision_step * self._world.episode.period
            link = simulation.first_collision_link or "arm"
            touched = f"Contact of {named(link)} at {when:.2f} s"
        if over and not verdict.valid:
            return f"Over, not counted: no box appeared. {touched}", _AMBER
        at_goal = verdict.reached if over else moment.reached
        reached = "at the goal" if at_goal else "not at the goal"
        if over:
            word = "Success" if verdict.success else "Failed"
            return f"{word}: {touched[0].lower()}{touched[1:]}, {reached}", (
                _GREEN if verdict.success else _RED
            )
        color = _RED if verdict.collided else _GREEN if at_goal else _GREY
        return f"{touched}, {reached}", color
