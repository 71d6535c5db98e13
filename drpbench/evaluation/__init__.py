"""A whole run and its metrics, and the witnesses: referee, doctor, verification."""

from .doctor import examine as examine
from .run import Request as Request
from .run import run as run
