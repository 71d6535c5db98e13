"""How the command line says no."""


class Refused(ValueError):
    """Bad input: what is wrong and what would be right, in one line."""
