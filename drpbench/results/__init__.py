"""Result files: rows, their journal, and what moved."""

from .journal import Journal as Journal
from .schema import Header as Header
from .schema import Result as Result
from .schema import ResultsError as ResultsError
from .schema import Row as Row
from .schema import load as load
from .schema import save as save
