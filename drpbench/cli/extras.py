"""Which packages beyond the core a command needs, and which extra installs them."""

from importlib.util import find_spec

from drpbench.errors import InputError

EXTRAS = {
    "train": ("mink", "optax", "orbax"),
    "record": ("PIL", "foxglove_schemas_protobuf", "mcap", "mcap_protobuf", "zstandard"),
}
"""Import names of an extra's packages, as in pyproject.toml."""


def require(extra: str, command: str) -> None:
    """Raises InputError, with the line that installs `extra`, if one of its packages is not
    there."""
    if missing := [name for name in EXTRAS[extra] if find_spec(name) is None]:
        raise InputError(
            f"{command} needs {', '.join(missing)}, which the core does not install: "
            f'pip install "drpbench[{extra}]"'
        )
