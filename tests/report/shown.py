"""Results to show in a report, some of them hostile."""

from drpbench.problems import load_set

from ..result_rows import result, row

EXPECTED = {"SE": 4, "FDO": 3}
HOSTILE = "<script>throw 1</script><!--\"'&{{data}}</title>"
DOT = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw=="


def some_results():
    """Two policies, one of them privileged and of a hostile name."""
    good = [row("SE", i) for i in range(4)] + [row("FDO", i, collided=i == 2) for i in range(3)]
    poor = [row("SE", i, reached=False, family=HOSTILE) for i in range(4)]
    poor += [row("FDO", 0, collided=True, first_collision_link=HOSTILE)]
    poor += [row("FDO", 1, reached=False, status=HOSTILE), row("FDO", 2)]
    of = {"problem_set_sha256": load_set().sha256}
    hostile = result(HOSTILE, poor, privileged=True, device=HOSTILE, **of)
    return {"good.json": result("good", good, **of), "it's.json": hostile}
