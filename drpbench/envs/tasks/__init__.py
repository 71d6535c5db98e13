"""The five tasks."""

from .appearing import Appearing
from .dynamic_goal_blocking import DynamicGoalBlocking
from .floating import Floating
from .goal_blocking import GoalBlocking
from .static import Static
from .task import Task as Task

TASKS: dict[str, Task] = {
    task.name: task
    for task in (Static(), Appearing(), Floating(), GoalBlocking(), DynamicGoalBlocking())
}
