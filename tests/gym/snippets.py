"""The Python of docs/environments.md."""

import re
from pathlib import Path

PAGE = (Path(__file__).parents[2] / "docs" / "environments.md").read_text()


def snippet(mentions):
    """Runs the page's one block of Python that mentions so; gives its names."""
    (block,) = (b for b in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if mentions in b)
    names = {}
    exec(block, names)
    return names
