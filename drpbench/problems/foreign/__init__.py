"""Problems in other projects' formats."""

from .importing import Imported as Imported
from .importing import import_problems as import_problems
from .problem import Foreign as Foreign
from .problem import ForeignError as ForeignError
