"""Problem sets: the frozen one that comes with the package, and yours from a file.

What made the frozen one is in `drpbench.generation`.
"""

from .goal_poses import goal_poses as goal_poses
from .library import PROBLEM_SET as PROBLEM_SET
from .library import load_set as load_set
from .library import matching as matching
from .lines import export_lines as export_lines
from .lines import to_json as to_json
from .problem_set import ProblemSet as ProblemSet
from .task_problems import ProblemSetError as ProblemSetError
from .task_problems import TaskProblems as TaskProblems
