"""The problems: frozen numbered sets. What made them is in `drpbench.generation`."""

from .frozen import PROBLEM_SET as PROBLEM_SET
from .frozen import TASKS as TASKS
from .frozen import ProblemSet as ProblemSet
from .frozen import ProblemSetError as ProblemSetError
from .frozen import counts as counts
from .frozen import load as load
