"""What is said of a policy that cannot be made, or that fails."""

import sysconfig
import traceback
from pathlib import Path

from drpbench.errors import DrpbenchError

_OURS = str(Path(__file__).parents[1])
_NOT_THEIRS = (_OURS, "<frozen", *{sysconfig.get_path(key) for key in ("stdlib", "purelib")})


class PolicyError(DrpbenchError):
    """A policy cannot be found, made or reached; the message is one line."""


class UnknownPolicy(PolicyError):
    """No policy of that name; the message lists those there are."""


def told(error: BaseException, most: int = 200) -> str:
    """An error in one line: its type, its message, and where in the policy's own code it was
    raised."""
    message = " ".join(str(error).split())
    text = f"{type(error).__name__}: {message}" if message else type(error).__name__
    if len(text) > most:
        text = text[: most - 3] + "..."
    theirs = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith(_NOT_THEIRS)
    ]
    return (
        f"{text} ({Path(theirs[-1].filename).name}, line {theirs[-1].lineno})" if theirs else text
    )
