"""Networks, and what they are built of."""

from .network import Network as Network
