"""What the command line turns into one line and exit code 2."""


class DrpbenchError(ValueError):
    """Something outside drpbench is not as expected: the message is one line that says what would
    be right."""


class InputError(DrpbenchError):
    """An option, an argument or a file's name is not one that the command takes."""
