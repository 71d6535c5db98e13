"""Problems in other projects' formats."""

from .importing import Imported as Imported
from .importing import import_problems as import_problems
from .problem import FormatError as FormatError
from .problem import OtherProblem as OtherProblem
