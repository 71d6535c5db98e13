"""What the command line turns into one line and exit code 2."""

from collections.abc import Iterable


class DrpbenchError(ValueError):
    """Something outside drpbench is not as expected: the message is one line that says what would
    be right."""


class InputError(DrpbenchError):
    """An option, an argument or a file's name is not one that the command takes."""


def suggested(wrong: str, known: Iterable[str]) -> str:
    """`; did you mean 'drp'?` where one of the known words is much like the wrong one, else
    empty: for the end of a message."""
    from difflib import get_close_matches

    by_lower = {one.lower(): one for one in known}
    close = get_close_matches(wrong.lower(), by_lower, 1, 0.6)
    return f"; did you mean {by_lower[close[0]]!r}?" if close else ""
