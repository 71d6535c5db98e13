"""How far a policy's skill carries: static problems at home and abroad, by family, as Markdown.

    python benchmarks/yardstick.py [--policies drp straight] [--problems 192]

At home: the benchmark's families, from the stream of validation. Abroad: the scenes of
`drpbench.generation.foreign`, which nothing is learned from. Settings may be chosen on these.
"""

import argparse
from collections import Counter

from drpbench.compile import use_cache
from drpbench.generation.training_problems import ABROAD, AT_HOME
from drpbench.learning.validation import Validation
from drpbench.plugins.registry import choose
from drpbench.ranking import wilson


def rate(k: int, n: int) -> str:
    """`k/n` and the share with its interval, in per cent."""
    low, high = wilson(k, n)
    return f"{k}/{n}, {100 * k / n:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--policies", nargs="+", default=["drp", "straight"])
    parser.add_argument("--problems", type=int, default=192, help="at home, and abroad")
    arguments = parser.parse_args()
    use_cache()
    places = {
        "at home": Validation(arguments.problems, families=AT_HOME),
        "abroad": Validation(arguments.problems, families=ABROAD),
    }
    print("| policy | where | family | success | collided | reached |\n|---|---|---|---|---|---|")
    for name in arguments.policies:
        policy = choose(name).policy
        for where, validation in places.items():
            verdict = validation.verdicts(policy)
            counts: dict[str, Counter] = {}
            for i, family in enumerate(validation.families):
                for one in ("all", family):
                    count = counts.setdefault(one, Counter())
                    count["n"] += 1
                    for kind in ("success", "collided", "reached"):
                        count[kind] += bool(getattr(verdict, kind)[i])
            for family, count in counts.items():
                cells = [rate(count["success"], count["n"])]
                cells += [str(count[kind]) for kind in ("collided", "reached")]
                print(f"| {name} | {where} | {family} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
