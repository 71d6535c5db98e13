"""Reports are of episodes as they are recorded."""

from ..recording.conftest import header, rolled, stored

__all__ = ["header", "rolled", "stored"]
